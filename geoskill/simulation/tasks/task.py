"""What every task offers."""

from abc import ABC, abstractmethod
from dataclasses import dataclass, field
from typing import final

import mujoco
import numpy as np
from jaxtyping import Float64

from geoskill.geometry.poses import Pose
from geoskill.simulation.actors.actor import Grip
from geoskill.simulation.parts import place
from geoskill.simulation.roles import SceneRole

Corner = tuple[float, float, float]
INFINITE = float("inf")


@final
@dataclass(frozen=True)
class RolePart:
    """A part of a body that has a role: what lies in a box in the body's frame, by default all of it."""

    body: str
    role: SceneRole
    lower: Corner = (-INFINITE, -INFINITE, -INFINITE)
    upper: Corner = (INFINITE, INFINITE, INFINITE)


@final
@dataclass(frozen=True)
class TablePlace:
    """Where something stands on the table: meters to the right of and behind its middle, and how it is turned."""

    x: float
    y: float
    yaw_rad: float


@final
@dataclass(frozen=True)
class Spread:
    """How far a place may lie from the usual one, uniformly to either side."""

    x: float
    y: float
    yaw_rad: float

    def around(self, place: TablePlace, random: np.random.Generator) -> TablePlace:
        """A random place near the usual one."""
        x, y, yaw = random.uniform(-1, 1, 3)
        return TablePlace(place.x + x * self.x, place.y + y * self.y, place.yaw_rad + yaw * self.yaw_rad)


class Carrying(ABC):
    """How the carried thing follows where it is led."""

    @abstractmethod
    def start(self, model: mujoco.MjModel, data: mujoco.MjData, led: Pose) -> None:
        """Put it where it is before the first frame."""

    @abstractmethod
    def lead(self, model: mujoco.MjModel, data: mujoco.MjData, led: Pose, held: bool, seconds: float) -> None:
        """Move it to the next frame's pose, in the time between two frames; `held` until it is let go."""


@final
@dataclass(frozen=True)
class Rigid(Carrying):
    """A body that goes exactly where it is led."""

    body: str

    def start(self, model: mujoco.MjModel, data: mujoco.MjData, led: Pose) -> None:
        """See :meth:`Carrying.start`."""
        place(model, data, self.body, led)
        mujoco.mj_forward(model, data)

    def lead(self, model: mujoco.MjModel, data: mujoco.MjData, led: Pose, held: bool, seconds: float) -> None:
        """See :meth:`Carrying.lead`."""
        place(model, data, self.body, led)
        mujoco.mj_forward(model, data)


@final
@dataclass(frozen=True, eq=False)
class TaskScene:
    """A task in one scene.

    Attributes:
        start: pose of the carried thing on the first frame.
        goal: on the last frame.
        approach: from the goal to where the thing is before the last straight stretch, in meters in the world.
        height: how high the path rises above the higher one of its ends, in meters.
        grip: how the carried thing is held.
        carrying: how it follows.
        extent: corners of the target and what comes to lie on it, in the frame of the goal; what is to be hidden.
        roles: the parts of bodies with a role; the first one that contains a point decides.
        cloth: name of the flexible part whose points have coordinates in its rest state, if there is one.
    """

    start: Pose
    goal: Pose
    approach: Float64[np.ndarray, "3"]
    height: float
    grip: Grip
    carrying: Carrying
    extent: Float64[np.ndarray, "corners 3"]
    roles: tuple[RolePart, ...]
    cloth: str | None = field(default=None)


class Task(ABC):
    """Puts a task's things on the table, which is the plane z = 0 with the camera at negative y."""

    @property
    @abstractmethod
    def name(self) -> str:
        """As on the command line."""

    @abstractmethod
    def build(
        self,
        spec: mujoco.MjSpec,
        target: TablePlace,
        start: TablePlace,
        looks: np.random.Generator,
        take: np.random.Generator,
    ) -> TaskScene:
        """Add the things to a scene.

        Args:
            spec: the scene.
            target: how the target is moved from its usual place.
            start: how the object's start is.
            looks: draws everything by which the things are recognized; the same in all recordings of a seed.
            take: draws what differs from recording to recording, such as where the object is held.
        """
