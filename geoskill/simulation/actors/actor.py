"""What every actor offers."""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import final

import mujoco
import numpy as np

from geoskill.geometry.poses import Pose
from geoskill.simulation.parts import moving_body

BODY = "actor"


@final
@dataclass(frozen=True, eq=False)
class Grip:
    """How a thing is held.

    Attributes:
        pose: of the grip in the thing's frame. The fingers close along the grip's x axis on its origin; the arm comes
            from its y axis, and its z axis is the way up.
        half_width_m: half of the distance of the fingers.
    """

    pose: Pose
    half_width_m: float


class Actor(ABC):
    """Fingers on an arm, drawn in the frame of the grip."""

    @abstractmethod
    def add(self, spec: mujoco.MjSpec, grip: Grip, looks: np.random.Generator) -> None:
        """Add the actor to a scene, its body named :data:`BODY`; its parts are added by `looks` in their colors."""

    @abstractmethod
    def open(self, model: mujoco.MjModel, data: mujoco.MjData, opening: float) -> None:
        """Move the fingers: 0 closed on the thing, 1 open."""


def add_root(spec: mujoco.MjSpec) -> mujoco.MjsBody:
    """The actor's body, whose frame is that of the grip."""
    return moving_body(spec, BODY)
