"""A plant without pictures: points of a box, projected with noise, and every fault of a selection on demand.

A box of 54 x 100 x 34 mm with 12 marked points is carried to a pose that is turned by up to 35 degrees, from 10 to
20 cm and up to 30 degrees away, by an actor that holds it somewhere and errs by 3 %. Detection errs by 0.5 px in every
coordinate of every frame.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, final

import numpy as np
from jaxtyping import Float64

from geoskill.control.action import Action, ActionSpace, Dof
from geoskill.control.camera_motion import CameraMotion, Depths, constant_depth
from geoskill.control.plant import Placement, Plant
from geoskill.control.rows import Constraint
from geoskill.control.state import Followed, Sighting
from geoskill.geometry.camera import PinholeCamera, focal_length_px, look_at, project
from geoskill.geometry.poses import Pose, pose, rotation_about, rotation_vector, transform
from geoskill.geometry.primitives import NodeType
from geoskill.kernels.kernel import Kernel

HALF_BOX: Final = np.array([0.027, 0.050, 0.017])
POINTS: Final = 12
WIDTH, HEIGHT, VIEW_RAD = 640, 480, math.radians(40)
TABLE: Final = np.array([0.02, 0.02, 0.02])
CAMERAS: Final = (np.array([0.0, -0.46, 0.56]), np.array([0.50, -0.10, 0.52]))
NOISE_PX: Final = 0.5
ACTUATION: Final = 0.03


@final
@dataclass(frozen=True)
class Faults:
    """How often a selection is wrong.

    Attributes:
        switches: probability with which a slot changes to another pair in a frame.
        wrong: with which a slot joins a carried point to a wrong resting one in a frame.
        missed: with which a slot has nothing in a frame.
        lost: with which all slots have nothing in a frame.
        is_late: whether the pictures are one frame old.
        miss_m: distance by which the pairs miss each other at the goal, meters.
    """

    switches: float = 0.0
    wrong: float = 0.0
    missed: float = 0.0
    lost: float = 0.0
    is_late: bool = False
    miss_m: float = 0.0


FAULTS: Final = {
    "none": Faults(),
    "switches": Faults(switches=0.15),
    "wrong": Faults(switches=0.15, wrong=0.20),
    "apart": Faults(miss_m=0.003),
    "all": Faults(0.15, 0.20, 0.20, 0.10, True),
    "all_apart": Faults(0.15, 0.20, 0.20, 0.10, True, 0.003),
}
"""Faults by their name on the command line."""


def points_cameras(count: int) -> tuple[PinholeCamera, ...]:
    """Return the cameras that look at the table: from the front, and from the right."""
    focal = focal_length_px(HEIGHT, VIEW_RAD)
    return tuple(PinholeCamera(WIDTH, HEIGHT, focal, look_at(position, TABLE)) for position in CAMERAS[:count])


@final
class PointsPlant(Plant):
    """One trial with points.

    Args:
        rng: draws the scene and everything that happens.
        space: what is commanded.
        cameras: that look on.
        kernels: kernel of each slot.
        faults: of the selection.
        has_support: whether the box comes to rest at the goal's height.
        knowledge: `none`, `camera` for a calibrated field with one rough depth, or `truth` for the exact field.
    """

    def __init__(
        self,
        rng: np.random.Generator,
        space: ActionSpace,
        cameras: Sequence[PinholeCamera],
        kernels: Sequence[Kernel],
        faults: Faults,
        *,
        has_support: bool,
        knowledge: str = "none",
    ) -> None:
        self._rng, self._space, self._cameras = rng, space, tuple(cameras)
        self._kernels, self._faults = tuple(kernels), faults
        self._has_support, self._knowledge = has_support, knowledge
        self._marks = _marks(rng)
        self._draw_scene()
        miss = rng.normal(size=(POINTS, 2))
        miss *= faults.miss_m / np.linalg.norm(miss, axis=1, keepdims=True)
        belong = np.column_stack([self._marks[:, :2] + miss, self._marks[:, 2]])
        self._resting = [project(camera, transform(self._goal, belong))[0] for camera in self._cameras]
        # Pairs are drawn among points that differ, so that a slot of lines has a direction.
        self._slots = [self._draw_pair(kernel) for kernel in self._kernels]
        self._acted: Action | None = None
        self._pending: tuple[Pose, Action | None] | None = None
        self._last: list[Float64[np.ndarray, "f 2"]] | None = None
        self._wrong = 0

    def _draw_scene(self) -> None:
        rng = self._rng
        height = HALF_BOX[2] + 0.006
        where = np.array([-0.06, 0.02, height]) + rng.uniform(-1, 1, 3) * [0.045, 0.035, 0.0]
        self._goal = pose(where, rotation_about(np.array([0.0, 0.0, rng.uniform(-1, 1) * math.radians(35)])))
        while True:
            distance, bearing = rng.uniform(0.10, 0.20), rng.uniform(-math.pi, math.pi)
            rise = rng.uniform(0.03, 0.08)
            flat = math.sqrt(max(distance**2 - rise**2, 0.0))
            start = where + np.array([flat * math.cos(bearing), flat * math.sin(bearing), rise])
            turn = rotation_about(np.array([0.0, 0.0, rng.uniform(-1, 1) * math.radians(30)]))
            self._pose = pose(start, turn @ self._goal[:3, :3])
            if all(_inside(camera, transform(self._pose, self._marks)) for camera in self._cameras):
                break
        self._grip = start + rng.uniform(-1, 1, 3) * [0.03, 0.05, 0.03]
        self._start = self._pose

    @property
    def start_mm(self) -> float:
        """Distance from the start to the goal, millimeters."""
        return 1000 * float(np.linalg.norm(self._start[:3, 3] - self._goal[:3, 3]))

    def look(self) -> Sighting:
        """See :meth:`Plant.look`."""
        seen_pose, acted = self._pose, self._acted
        if self._faults.is_late:
            seen_pose, acted = self._pending or (self._pose, None)
            self._pending = self._pose, self._acted
        features = [
            self._seen(camera, resting, seen_pose) for camera, resting in zip(self._cameras, self._resting, strict=True)
        ]
        followed = [Followed.none()] * len(features)
        if self._last is not None:
            followed = [Followed(before, after) for before, after in zip(self._last, features, strict=True)]
        self._last = features
        constraints = self._constraints(features)
        return Sighting(constraints, followed, acted, self._touches(), self._motions(seen_pose))

    def _seen(
        self, camera: PinholeCamera, resting: Float64[np.ndarray, "p 2"], seen_pose: Pose
    ) -> Float64[np.ndarray, "f 2"]:
        """Return the noisy pixels of the carried points, then of those at rest."""
        pixels = np.vstack([project(camera, transform(seen_pose, self._marks))[0], resting])
        return pixels + self._rng.normal(0, NOISE_PX, pixels.shape)

    def _constraints(self, features: Sequence[Float64[np.ndarray, "f 2"]]) -> list[Constraint]:
        rng, faults = self._rng, self._faults
        constraints: list[Constraint] = []
        all_lost = rng.uniform() < faults.lost
        first_is_wrong = False
        for slot, kernel in enumerate(self._kernels):
            if rng.uniform() < faults.switches:
                self._slots[slot] = self._draw_pair(kernel)
            carried_ids = self._slots[slot]
            is_wrong = rng.uniform() < faults.wrong
            resting_ids = rng.permutation(POINTS)[: len(carried_ids)] if is_wrong else carried_ids
            first_is_wrong |= is_wrong and slot == 0
            missed = rng.uniform() < faults.missed or all_lost
            if missed:
                continue
            for camera, pixels in enumerate(features):
                carried = pixels[carried_ids]
                resting = pixels[POINTS + np.asarray(resting_ids)]
                nodes = _nodes(kernel, carried, resting)
                constraints.append(
                    Constraint(kernel, nodes, (True, False), camera=camera, member=kernel.name, rank=slot + 1)
                )
        self._wrong += first_is_wrong
        return constraints

    def _draw_pair(self, kernel: Kernel) -> list[int]:
        count = 2 if NodeType.LINE in kernel.roles else 1
        while True:
            chosen = [int(own) for own in self._rng.permutation(POINTS)[:count]]
            if count == 1 or np.linalg.norm(self._marks[chosen[0]] - self._marks[chosen[1]]) > 0.04:
                return chosen

    def _motions(self, seen_pose: Pose) -> list[CameraMotion] | None:
        if self._knowledge == "none":
            return None
        motions = []
        for camera in self._cameras:
            pixels, depth = project(camera, transform(seen_pose, self._marks))
            rough = constant_depth(float(depth.mean()))
            exact = _nearest_depth(pixels, depth)
            motions.append(
                CameraMotion(camera, self._space, self._grip, exact if self._knowledge == "truth" else rough)
            )
        return motions

    def act(self, action: Action) -> None:
        """See :meth:`Plant.act`."""
        done = action * (1 + ACTUATION * self._rng.normal(size=len(action)))
        moved, grip = carried_out(self._pose, self._grip, self._space.basis @ done)
        if self._has_support and (below := self._goal[2, 3] - moved[2, 3]) > 0:
            moved[2, 3] += below
            grip[2] += below
            if (z := self._space.index(Dof.Z)) is not None:
                done[z] += below
        self._pose, self._grip, self._acted = moved, grip, done

    def _touches(self) -> bool:
        return self._has_support and bool(self._pose[2, 3] <= self._goal[2, 3] + 1e-9)

    def placement(self) -> Placement:
        """See :meth:`Plant.placement`."""
        return placement_of(self._cameras[0], self._pose, self._goal)

    def wrong_associations(self) -> int:
        """See :meth:`Plant.wrong_associations`."""
        return self._wrong


def carried_out(
    body: Pose, grip: Float64[np.ndarray, "3"], twist: Float64[np.ndarray, "6"]
) -> tuple[Pose, Float64[np.ndarray, "3"]]:
    """Return pose and grip after a displacement about the grip."""
    turn = rotation_about(twist[3:])
    position = grip + turn @ (body[:3, 3] - grip) + twist[:3]
    return pose(position, turn @ body[:3, :3]), grip + twist[:3]


def placement_of(camera: PinholeCamera, body: Pose, goal: Pose) -> Placement:
    """Return how far a body is from its goal, along and across the line of sight to the goal."""
    offset = body[:3, 3] - goal[:3, 3]
    ray = goal[:3, 3] - camera.pose[:3, 3]
    along = float(offset @ ray / np.linalg.norm(ray))
    distance = float(np.linalg.norm(offset))
    angle = float(np.linalg.norm(rotation_vector(body[:3, :3] @ goal[:3, :3].T)))
    across = math.sqrt(max(distance**2 - along**2, 0.0))
    return Placement(1000 * distance, 1000 * abs(along), 1000 * across, math.degrees(angle))


def _marks(rng: np.random.Generator) -> Float64[np.ndarray, "p 3"]:
    """Return points on the top and on the front of the box, in its frame."""
    marks = rng.uniform(-1, 1, (POINTS, 3)) * HALF_BOX
    marks[:8, 2] = HALF_BOX[2]
    marks[8:, 1] = -HALF_BOX[1]
    return np.asarray(marks)


def _inside(camera: PinholeCamera, points: Float64[np.ndarray, "p 3"]) -> bool:
    pixels, _ = project(camera, points)
    return bool((pixels > 20).all() and (pixels < [WIDTH - 20, HEIGHT - 20]).all())


def _nodes(
    kernel: Kernel, carried: Float64[np.ndarray, "c 2"], resting: Float64[np.ndarray, "c 2"]
) -> tuple[Float64[np.ndarray, " _"], ...]:
    """Return the carried node, then the resting one: a point, or the segment between two points."""
    nodes = []
    for role, points in zip(kernel.roles, (carried, resting), strict=True):
        nodes.append(points.reshape(-1)[: role.geometry_dim])
    return tuple(nodes)


def _nearest_depth(pixels: Float64[np.ndarray, "p 2"], depth: Float64[np.ndarray, " p"]) -> Depths:
    def depths(points: Float64[np.ndarray, "m 2"]) -> Float64[np.ndarray, " m"]:
        distances = np.linalg.norm(points[:, None] - pixels[None], axis=2)
        return np.asarray(depth[distances.argmin(axis=1)])

    return depths
