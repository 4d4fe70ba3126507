"""A flexible sheet on the table, whose edge is moved.

The sheet is a MuJoCo flex: a grid of vertices with elastic resistance to stretching and bending. Since nothing in a
scene collides, this module itself handles the contact of the sheet with the table and with its own lower layer.
"""

import math
from dataclasses import dataclass
from typing import final

import mujoco
import numpy as np
from jaxtyping import Bool, Float64, Int

from geoskill.geometry.poses import Pose, inverse, quaternion, transform
from geoskill.simulation.tasks.task import ObjectDynamics

COLUMNS, ROWS = 17, 11
# Half of the drawn thickness of the sheet.
RADIUS = 0.0008
MASS_KG = 0.03
# As stiff as a tea towel in bending. A real one is far stiffer in stretching, which would need far smaller time steps.
YOUNG_PA, POISSON, ELASTIC_THICKNESS = 3000.0, 0.3, 0.006
STEP_S = 0.001
# Air drag, per second.
DRAG = 8.0
FRICTION, GRAVITY = 0.9, 9.81
# Distance between the layers of the folded sheet, larger than their thickness, so that the depth tells them apart; and
# the length beside the crease over which the upper layer rises to it.
LAYER, LAYER_RISES_OVER = 0.003, 0.02
SETTLING_S = 0.8


@final
@dataclass(frozen=True, eq=False)
class Sheet(ObjectDynamics):
    """A sheet whose one end is folded over onto the other.

    In its own frame the sheet lies flat at z = 0 around the origin. The object's pose is one on the sheet's edge at +x,
    with the edge along the pose's y axis. About that axis the edge turns by more than the pose does, as cloth does
    between fingers.

    Attributes:
        name: of the flex, and of the body to which it belongs.
        sheet_pose: pose of the sheet's frame in the world.
        half_size: half sizes along x and y, meters.
        fixed: the x up to which the sheet does not move.
        crease: the x of the fold; what is beyond comes to lie on what is before.
        pinched: lowest and highest y of the part of the edge that is held.
        rolls: of the object's pose about the sheet's y axis, decreasing from the start to the goal, radians.
        slopes: of the sheet toward its edge at each roll, radians; pi when it lies upside down.
    """

    name: str
    sheet_pose: Pose
    half_size: tuple[float, float]
    fixed: float
    crease: float
    pinched: tuple[float, float]
    rolls: tuple[float, ...]
    slopes: tuple[float, ...]

    def add(self, spec: mujoco.MjSpec, material: str) -> None:
        """Add the sheet to a scene, and set the scene's time step."""
        spec.option.timestep = STEP_S
        sheet_pose = self.sheet_pose
        body = spec.worldbody.add_body(name=self.name, pos=sheet_pose[:3, 3], quat=quaternion(sheet_pose[:3, :3]))
        rest = self._rest()
        owners, coordinates = self._add_vertices(body, rest)
        spec.add_flex(
            name=self.name,
            dim=2,
            radius=RADIUS,
            vertbody=owners,
            vert=coordinates,
            elem=_triangles().ravel().tolist(),
            # Texture rows go down.
            texcoord=(0.5 + rest[:, :2] / (2 * self.half_size[0], -2 * self.half_size[1])).ravel().tolist(),
            material=[material],
            elastic2d=3,  # bending and stretching
            young=YOUNG_PA,
            poisson=POISSON,
            thickness=ELASTIC_THICKNESS,
            contype=0,
            conaffinity=0,
            selfcollide=mujoco.mjtFlexSelf.mjFLEXSELF_NONE,
        )

    def _add_vertices(
        self, body: mujoco.MjsBody, rest: Float64[np.ndarray, "vertices 3"]
    ) -> tuple[list[str], list[float]]:
        """Add a body with three sliding joints per moving vertex.

        Returns:
            The body of each vertex, and the vertices' coordinates in these bodies, three per vertex.
        """
        mass = MASS_KG / len(rest)
        owners, coordinates = [], []
        for index, (position, moves) in enumerate(zip(rest, self._moves(), strict=True)):
            if not moves:
                owners.append(self.name)
                coordinates.extend(position)
                continue
            vertex = body.add_body(
                name=f"{self.name}_{index}", pos=position, mass=mass, inertia=[1e-9] * 3, explicitinertial=True
            )
            for axis in np.eye(3):
                vertex.add_joint(type=mujoco.mjtJoint.mjJNT_SLIDE, axis=axis)
            owners.append(vertex.name)
            coordinates.extend((0.0, 0.0, 0.0))
        return owners, coordinates

    def start(self, model: mujoco.MjModel, data: mujoco.MjData, object_pose: Pose) -> None:
        """See :meth:`ObjectDynamics.start`."""
        self.move(model, data, object_pose, True, SETTLING_S)

    def move(self, model: mujoco.MjModel, data: mujoco.MjData, object_pose: Pose, held: bool, seconds: float) -> None:
        """See :meth:`ObjectDynamics.move`."""
        rest = self._rest()[self._moves()]
        first = int(model.jnt_qposadr[model.body(f"{self.name}_{self._moves().argmax()}").jntadr[0]])
        moving = slice(first, first + rest.size)
        others = np.delete(np.arange(model.nq), moving)
        kept = data.qpos[others].copy()
        shifts, speeds = data.qpos[moving].reshape(-1, 3), data.qvel[moving].reshape(-1, 3)

        gripped = np.flatnonzero(self._is_pinched(rest) & held)
        ends = self._gripped_positions(inverse(self.sheet_pose) @ object_pose, rest[gripped]) - rest[gripped]
        begins = shifts[gripped].copy()
        steps = max(1, round(seconds / STEP_S))
        for share in np.arange(1, steps + 1) / steps:
            shifts[gripped] = begins + share * (ends - begins)
            speeds[gripped] = (ends - begins) / seconds
            mujoco.mj_step(model, data)
            speeds *= 1 - DRAG * STEP_S
            self._resolve_contact(rest, shifts, speeds)
        shifts[gripped] = ends
        # The steps also let the actor's fingers fall, whose opening is prescribed and not simulated.
        data.qpos[others] = kept
        data.qvel[others] = 0
        mujoco.mj_forward(model, data)

    def _gripped_positions(
        self, edge_pose: Pose, points: Float64[np.ndarray, "held 3"]
    ) -> Float64[np.ndarray, "held 3"]:
        """Return the positions of the held points for a pose of the edge, all in the sheet's frame."""
        roll = math.atan2(edge_pose[0, 2], edge_pose[2, 2])
        slope = float(np.interp(-roll, np.negative(self.rolls), self.slopes))
        edge = transform(edge_pose, points * [0.0, 1.0, 0.0])
        # Cloth hardly stretches: where the actor goes farther than the sheet reaches, the edge slips.
        border = np.column_stack([np.full(len(points), self.fixed), points[:, 1], np.zeros(len(points))])
        distances = np.linalg.norm(edge - border, axis=1, keepdims=True)
        edge = border + (edge - border) * np.minimum(1, (self.half_size[0] - self.fixed) / np.maximum(distances, 1e-9))
        outward = np.array([math.cos(slope), 0.0, math.sin(slope)])
        return np.asarray(edge + (points[:, :1] - self.half_size[0]) * outward)

    def _resolve_contact(
        self,
        rest: Float64[np.ndarray, "moving 3"],
        shifts: Float64[np.ndarray, "moving 3"],
        speeds: Float64[np.ndarray, "moving 3"],
    ) -> None:
        """Keep the vertices above the table, or above the lower layer, and apply friction to those that lie on it.

        Args:
            rest: positions at rest.
            shifts: from the positions at rest; changed in place.
            speeds: changed in place.
        """
        rise = np.clip((self.crease - rest[:, 0] - shifts[:, 0]) / LAYER_RISES_OVER, 0, 1)
        floor = np.where(rest[:, 0] > self.crease, LAYER * rise, 0.0)
        lies = shifts[:, 2] <= floor
        shifts[lies, 2] = floor[lies]
        speeds[lies, 2] = np.maximum(speeds[lies, 2], 0)
        slip = np.linalg.norm(speeds[lies, :2], axis=1, keepdims=True)
        speeds[lies, :2] *= np.maximum(0, 1 - FRICTION * GRAVITY * STEP_S / np.maximum(slip, 1e-9))

    def _rest(self) -> Float64[np.ndarray, "vertices 3"]:
        """Return the vertices of the flat sheet, column by column from -x, within a column from -y."""
        x, y = (np.linspace(-half, half, count) for half, count in zip(self.half_size, (COLUMNS, ROWS), strict=True))
        return np.column_stack([np.repeat(x, ROWS), np.tile(y, COLUMNS), np.zeros(COLUMNS * ROWS)])

    def _moves(self) -> Bool[np.ndarray, " vertices"]:
        """Return which vertices can move."""
        return np.asarray(self._rest()[:, 0] > self.fixed)

    def _is_pinched(self, rest: Float64[np.ndarray, "moving 3"]) -> Bool[np.ndarray, " moving"]:
        """Return which of the moving vertices are between the fingers while the sheet is held."""
        # Two columns, since a single one would not define the slope of the sheet there.
        at_edge = rest[:, 0] > self.half_size[0] * (1 - 3 / (COLUMNS - 1))
        return np.asarray(at_edge & (rest[:, 1] >= self.pinched[0]) & (rest[:, 1] <= self.pinched[1]))


def _triangles() -> Int[np.ndarray, "triangles 3"]:
    """Return two triangles per cell, with alternating diagonals, so that all directions bend equally easily."""
    corners = []
    for column in range(COLUMNS - 1):
        for row in range(ROWS - 1):
            a = column * ROWS + row
            b, c, d = a + ROWS, a + ROWS + 1, a + 1
            corners += [(a, b, c), (a, c, d)] if (column + row) % 2 == 0 else [(a, b, d), (b, c, d)]
    return np.array(corners)
