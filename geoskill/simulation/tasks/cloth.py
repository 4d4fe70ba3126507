"""A flexible sheet on the table, and how its edge is led.

The sheet is a MuJoCo flex: a grid of vertices that are pulled by their neighbors when the sheet is stretched or bent.
Nothing in a scene collides, so what the sheet lies on is left to this module: the table, and its own lower layer.
"""

import math
from dataclasses import dataclass
from typing import final

import mujoco
import numpy as np
from jaxtyping import Bool, Float64, Int

from geoskill.geometry.poses import Pose, inverse, quaternion, transform
from geoskill.simulation.tasks.task import Carrying

COLUMNS, ROWS = 17, 11
# Half of what is drawn as the sheet's thickness.
RADIUS = 0.0008
MASS_KG = 0.03
# As stiff as a tea towel in bending. In stretching a real one is far stiffer, which would need far smaller steps.
YOUNG_PA, POISSON, ELASTIC_THICKNESS = 3000.0, 0.3, 0.006
STEP_S = 0.001
# Of the air, per second.
DRAG = 8.0
FRICTION, GRAVITY = 0.9, 9.81
# Between the layers of the folded sheet; more than they are thick, so that it is clear which one is seen.
LAYER, LAYER_RISES_OVER = 0.003, 0.02
SETTLING_S = 0.8


@final
@dataclass(frozen=True, eq=False)
class Sheet(Carrying):
    """A sheet of which one end is folded over onto the other.

    In its own frame the sheet lies flat at z = 0 around the origin, and what is led is a pose on its edge at +x, with
    the edge along the pose's y axis. The edge turns about that axis by more than the pose does, as between fingers.

    Attributes:
        name: of the flex, and of the body that it belongs to.
        placed: pose of the sheet's frame in the world.
        half: half sizes along x and y, meters.
        fixed: up to this x the sheet stays where it is.
        crease: the x of the fold; what is beyond comes to lie on what is before.
        pinched: from which to which y the edge is held.
        rolls: of the led pose about the sheet's y axis, falling from the start to the goal, radians.
        slopes: how steeply the sheet rises toward its edge at each of these; half a turn when it lies upside down.
    """

    name: str
    placed: Pose
    half: tuple[float, float]
    fixed: float
    crease: float
    pinched: tuple[float, float]
    rolls: tuple[float, ...]
    slopes: tuple[float, ...]

    def add(self, spec: mujoco.MjSpec, material: str) -> None:
        """Add the sheet to a scene."""
        spec.option.timestep = STEP_S
        body = spec.worldbody.add_body(name=self.name, pos=self.placed[:3, 3], quat=quaternion(self.placed[:3, :3]))
        rest = self._rest()
        mass = MASS_KG / len(rest)
        owners, places = [], []
        for number, (place, moves) in enumerate(zip(rest, self._moves(), strict=True)):
            if not moves:
                owners.append(self.name)
                places.extend(place)
                continue
            vertex = body.add_body(
                name=f"{self.name}_{number}", pos=place, mass=mass, inertia=[1e-9] * 3, explicitinertial=True
            )
            for axis in np.eye(3):
                vertex.add_joint(type=mujoco.mjtJoint.mjJNT_SLIDE, axis=axis)
            owners.append(vertex.name)
            places.extend((0.0, 0.0, 0.0))
        spec.add_flex(
            name=self.name,
            dim=2,
            radius=RADIUS,
            vertbody=owners,
            vert=places,
            elem=_triangles().ravel().tolist(),
            texcoord=(0.5 + rest[:, :2] / (2 * self.half[0], -2 * self.half[1])).ravel().tolist(),  # rows go down
            material=[material],
            elastic2d=3,  # bending and stretching
            young=YOUNG_PA,
            poisson=POISSON,
            thickness=ELASTIC_THICKNESS,
            contype=0,
            conaffinity=0,
            selfcollide=mujoco.mjtFlexSelf.mjFLEXSELF_NONE,
        )

    def start(self, model: mujoco.MjModel, data: mujoco.MjData, led: Pose) -> None:
        """See :meth:`Carrying.start`."""
        self.lead(model, data, led, True, SETTLING_S)

    def lead(self, model: mujoco.MjModel, data: mujoco.MjData, led: Pose, held: bool, seconds: float) -> None:
        """See :meth:`Carrying.lead`."""
        rest = self._rest()[self._moves()]
        first = int(model.jnt_qposadr[model.body(f"{self.name}_{self._moves().argmax()}").jntadr[0]])
        moving = slice(first, first + rest.size)
        others = np.delete(np.arange(model.nq), moving)
        kept = data.qpos[others].copy()
        shifts, speeds = data.qpos[moving].reshape(-1, 3), data.qvel[moving].reshape(-1, 3)

        gripped = np.flatnonzero(self._pinched(rest) & held)
        ends = self._led(inverse(self.placed) @ led, rest[gripped]) - rest[gripped]
        begins = shifts[gripped].copy()
        steps = max(1, round(seconds / STEP_S))
        for share in np.arange(1, steps + 1) / steps:
            shifts[gripped] = begins + share * (ends - begins)
            speeds[gripped] = (ends - begins) / seconds
            mujoco.mj_step(model, data)
            speeds *= 1 - DRAG * STEP_S
            self._lie(rest, shifts, speeds)
        shifts[gripped] = ends
        # The steps also let the actor's fingers fall, which are opened and closed as needed and not by forces.
        data.qpos[others] = kept
        data.qvel[others] = 0
        mujoco.mj_forward(model, data)

    def _led(self, led: Pose, points: Float64[np.ndarray, "held 3"]) -> Float64[np.ndarray, "held 3"]:
        """Where the held points go, all in the sheet's frame."""
        roll = math.atan2(led[0, 2], led[2, 2])
        slope = float(np.interp(-roll, np.negative(self.rolls), self.slopes))
        edge = transform(led, points * [0.0, 1.0, 0.0])
        # Cloth hardly stretches: where the actor goes farther than it reaches, the edge slips.
        border = np.column_stack([np.full(len(points), self.fixed), points[:, 1], np.zeros(len(points))])
        apart = np.linalg.norm(edge - border, axis=1, keepdims=True)
        edge = border + (edge - border) * np.minimum(1, (self.half[0] - self.fixed) / np.maximum(apart, 1e-9))
        outward = np.array([math.cos(slope), 0.0, math.sin(slope)])
        return np.asarray(edge + (points[:, :1] - self.half[0]) * outward)

    def _lie(
        self,
        rest: Float64[np.ndarray, "moving 3"],
        shifts: Float64[np.ndarray, "moving 3"],
        speeds: Float64[np.ndarray, "moving 3"],
    ) -> None:
        """Keep the vertices over the table, or over the lower layer, and let them rub on it."""
        before = np.clip((self.crease - rest[:, 0] - shifts[:, 0]) / LAYER_RISES_OVER, 0, 1)
        floor = np.where(rest[:, 0] > self.crease, LAYER * before, 0.0)
        lies = shifts[:, 2] <= floor
        shifts[lies, 2] = floor[lies]
        speeds[lies, 2] = np.maximum(speeds[lies, 2], 0)
        slip = np.linalg.norm(speeds[lies, :2], axis=1, keepdims=True)
        speeds[lies, :2] *= np.maximum(0, 1 - FRICTION * GRAVITY * STEP_S / np.maximum(slip, 1e-9))

    def _rest(self) -> Float64[np.ndarray, "vertices 3"]:
        """The vertices of the flat sheet, column by column from -x, each from -y."""
        x, y = (np.linspace(-half, half, count) for half, count in zip(self.half, (COLUMNS, ROWS), strict=True))
        return np.column_stack([np.repeat(x, ROWS), np.tile(y, COLUMNS), np.zeros(COLUMNS * ROWS)])

    def _moves(self) -> Bool[np.ndarray, " vertices"]:
        """Which vertices do not stay where they are."""
        return np.asarray(self._rest()[:, 0] > self.fixed)

    def _pinched(self, rest: Float64[np.ndarray, "moving 3"]) -> Bool[np.ndarray, " moving"]:
        """Which of the moving vertices are held while the sheet is."""
        # Two columns, since one alone does not say how the sheet is turned there.
        at_edge = rest[:, 0] > self.half[0] * (1 - 3 / (COLUMNS - 1))
        return np.asarray(at_edge & (rest[:, 1] >= self.pinched[0]) & (rest[:, 1] <= self.pinched[1]))


def _triangles() -> Int[np.ndarray, "triangles 3"]:
    """Two to a cell; their diagonals alternate, so that no direction bends more easily than another."""
    corners = []
    for column in range(COLUMNS - 1):
        for row in range(ROWS - 1):
            a = column * ROWS + row
            b, c, d = a + ROWS, a + ROWS + 1, a + 1
            corners += [(a, b, c), (a, c, d)] if (column + row) % 2 == 0 else [(a, b, d), (b, c, d)]
    return np.array(corners)
