"""Interface of the tasks: a scene on the table, with the object's start and goal."""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import ClassVar, final

import mujoco
import numpy as np
from jaxtyping import Float64

from geoskill.geometry.poses import Pose
from geoskill.simulation.actors.actor import Grip
from geoskill.simulation.roles import SceneRole
from geoskill.simulation.shapes import set_body_pose

Corner = tuple[float, float, float]
INFINITE = float("inf")


@final
@dataclass(frozen=True)
class RolePart:
    """A part of a body that has a role: the points within a box in the body's frame, by default the whole body.

    Attributes:
        body: name of the body.
        role: of the part.
        lower: lower corner of the box, meters.
        upper: upper corner of the box, meters.
    """

    body: str
    role: SceneRole
    lower: Corner = (-INFINITE, -INFINITE, -INFINITE)
    upper: Corner = (INFINITE, INFINITE, INFINITE)


@final
@dataclass(frozen=True)
class PlanarPose:
    """Position and heading on the table.

    Attributes:
        x: to the right of the table's center, meters.
        y: away from the camera, meters.
        yaw_rad: turn about the vertical, counterclockwise from above.
    """

    x: float
    y: float
    yaw_rad: float


@final
@dataclass(frozen=True)
class PlacementRange:
    """Largest deviations of a placement, to either side; meters and radians."""

    x: float
    y: float
    yaw_rad: float

    def sample_around(self, center: PlanarPose, rng: np.random.Generator) -> PlanarPose:
        """Draw a placement around a center, uniformly."""
        x, y, yaw = rng.uniform(-1, 1, 3)
        return PlanarPose(center.x + x * self.x, center.y + y * self.y, center.yaw_rad + yaw * self.yaw_rad)

    def scaled(self, factor: float) -> "PlacementRange":
        """Return a range that is wider or narrower by a factor."""
        return PlacementRange(self.x * factor, self.y * factor, self.yaw_rad * factor)


class ObjectDynamics(ABC):
    """Response of the object to the poses that its scripted motion prescribes."""

    @abstractmethod
    def start(self, model: mujoco.MjModel, data: mujoco.MjData, object_pose: Pose) -> None:
        """Put the object at its pose before the first frame."""

    @abstractmethod
    def move(self, model: mujoco.MjModel, data: mujoco.MjData, object_pose: Pose, held: bool, seconds: float) -> None:
        """Move the object to the next frame's pose.

        Args:
            model: the scene.
            data: its state, which is changed.
            object_pose: the next pose in the world.
            held: whether the actor still holds the object.
            seconds: time between the two frames.
        """


@final
@dataclass(frozen=True)
class RigidObject(ObjectDynamics):
    """A rigid body that follows its prescribed pose exactly.

    Attributes:
        body: name of the body.
    """

    body: str

    def start(self, model: mujoco.MjModel, data: mujoco.MjData, object_pose: Pose) -> None:
        """See :meth:`ObjectDynamics.start`."""
        set_body_pose(model, data, self.body, object_pose)
        mujoco.mj_forward(model, data)

    def move(self, model: mujoco.MjModel, data: mujoco.MjData, object_pose: Pose, held: bool, seconds: float) -> None:
        """See :meth:`ObjectDynamics.move`."""
        set_body_pose(model, data, self.body, object_pose)
        mujoco.mj_forward(model, data)


@final
@dataclass(frozen=True, eq=False)
class TaskScene:
    """A task in one scene.

    Attributes:
        start: pose of the object on the first frame, in the world.
        goal: pose of the object on the last frame, in the world.
        approach: from the goal to the beginning of the path's final straight segment, in the world, meters.
        height: rise of the path above the higher of its ends, meters.
        grip: how the object is held.
        dynamics: how the object follows its path.
        extent: corners of the target and what comes to lie on it, in the goal's frame, to be hidden by an occluder.
        roles: the parts of bodies that have a role; the first that contains a point counts.
        cloth: name of the cloth, whose points have coordinates in its rest state, if there is one.
        solid: whether things stop each other as they are drawn, so that the object at its goal rests on something.
        free_axis: in the object's frame, about which the goal leaves the object free to turn, if there is one.
    """

    start: Pose
    goal: Pose
    approach: Float64[np.ndarray, "3"]
    height: float
    grip: Grip
    dynamics: ObjectDynamics
    extent: Float64[np.ndarray, "corners 3"]
    roles: tuple[RolePart, ...]
    cloth: str | None = None
    solid: bool = True
    free_axis: Float64[np.ndarray, "3"] | None = None


class Task(ABC):
    """A task that adds its things to the table, which is the plane z = 0 with the camera at negative y.

    Attributes:
        name: as on the command line; the module has the same name.
    """

    name: ClassVar[str]

    @abstractmethod
    def build(
        self,
        spec: mujoco.MjSpec,
        target: PlanarPose,
        start: PlanarPose,
        appearance_rng: np.random.Generator,
        episode_rng: np.random.Generator,
    ) -> TaskScene:
        """Add the task's things to a scene.

        Args:
            spec: the scene.
            target: displacement of the target from its usual placement.
            start: displacement of the object's start from its usual placement.
            appearance_rng: draws the appearance of things, which is the same in all recordings of a seed.
            episode_rng: draws what differs between recordings, such as where the object is held.
        """
