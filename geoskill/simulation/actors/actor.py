"""Interface of the actors."""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import final

import mujoco
import numpy as np

from geoskill.geometry.poses import Pose
from geoskill.simulation.shapes import add_mocap_body

BODY = "actor"


@final
@dataclass(frozen=True, eq=False)
class Grip:
    """Grip of an actor on an object.

    Attributes:
        pose: of the grip in the object's frame. The fingers close along the grip's x axis on its origin; the arm comes
            from the direction of its y axis, and its z axis points up.
        half_width_m: half of the distance between the closed fingers.
    """

    pose: Pose
    half_width_m: float


class Actor(ABC):
    """Fingers on an arm, modeled in the frame of the grip."""

    @abstractmethod
    def add(self, spec: mujoco.MjSpec, grip: Grip, appearance_rng: np.random.Generator) -> None:
        """Add the actor to a scene, under a root body named :data:`BODY`; ``appearance_rng`` draws its colors."""

    @abstractmethod
    def set_opening(self, model: mujoco.MjModel, data: mujoco.MjData, opening: float) -> None:
        """Move the fingers: 0 is closed on the object, 1 is open."""


def add_root(spec: mujoco.MjSpec) -> mujoco.MjsBody:
    """Add the actor's root body, whose frame is that of the grip."""
    return add_mocap_body(spec, BODY)
