"""Degrees of freedom of the actor, and the limits of one step.

An action is the displacement of one step: meters along, radians about the axes of the robot's base, about the grip
(the actor's tool point). A twist is ``[vx, vy, vz, wx, wy, wz]``.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from functools import cached_property
from typing import Final, final

import numpy as np
from jaxtyping import Float64

Action = Float64[np.ndarray, " n"]


@final
class Dof(StrEnum):
    """A degree of freedom of the grip; the values are the names used in files."""

    X = "x"
    Y = "y"
    Z = "z"
    ROLL = "roll"
    PITCH = "pitch"
    YAW = "yaw"

    @property
    def is_rotation(self) -> bool:
        """Whether it is an angle."""
        return self in (Dof.ROLL, Dof.PITCH, Dof.YAW)


UPRIGHT: Final = (Dof.X, Dof.Y, Dof.Z, Dof.YAW)
DOF_SETS: Final = {"descent": UPRIGHT, "xyzy": UPRIGHT, "xyzabc": tuple(Dof)}
"""Degrees of freedom by the value of ``dof``; of ``descent``, z is not driven by the picture."""


@final
@dataclass(frozen=True)
class Limits:
    """Largest displacement of one step, and from where the actor was when it began.

    Attributes:
        step_m: of one step along any axis, meters.
        step_rad: of one step about any axis, radians.
        travel_m: along any axis since the beginning, to either side, meters.
        travel_rad: about any axis since the beginning, radians.
        down_m: along z downward since the beginning, meters: the floor.

    Raises:
        ValueError: when one of them is not positive and finite.
    """

    step_m: float = 0.012
    step_rad: float = math.radians(3.4)
    travel_m: float = 0.35
    travel_rad: float = math.radians(75)
    down_m: float = 0.35

    def __post_init__(self) -> None:
        for name in ("step_m", "step_rad", "travel_m", "travel_rad", "down_m"):
            if not 0 < getattr(self, name) < math.inf:
                raise ValueError(f"{name}={getattr(self, name)}: expected a positive number")


@final
@dataclass(frozen=True)
class ActionSpace:
    """The degrees of freedom that are commanded, with their limits.

    Attributes:
        dofs: in the order of an action's components.
        limits: of one step and of the whole way.
    """

    dofs: tuple[Dof, ...] = UPRIGHT
    limits: Limits = Limits()

    @cached_property
    def step(self) -> Action:
        """Largest displacement of one step in each component."""
        return self.of(self.limits.step_m, self.limits.step_rad)

    def of(self, meters: float, radians: float) -> Action:
        """Return an action with one value in all translations and another in all rotations."""
        return np.array([radians if dof.is_rotation else meters for dof in self.dofs])

    @cached_property
    def basis(self) -> Float64[np.ndarray, "6 n"]:
        """The twist of one unit of each component."""
        return np.asarray(np.eye(6)[:, [list(Dof).index(dof) for dof in self.dofs]])

    def index(self, dof: Dof) -> int | None:
        """Return the component of a degree of freedom, or None when it is not commanded."""
        return self.dofs.index(dof) if dof in self.dofs else None

    def limited(self, action: Action) -> Action:
        """Return the action scaled so that no component exceeds the limit of a step; the direction stays.

        >>> ActionSpace((Dof.X, Dof.Y), Limits(step_m=0.01)).limited(np.array([0.03, -0.015]))
        array([ 0.01 , -0.005])
        """
        # Beyond a million steps the ratio is of no interest, and might not be a number.
        action = np.clip(action, -1e6 * self.step, 1e6 * self.step)
        excess = float(np.max(np.abs(action) / self.step, initial=0.0))
        return action / excess if excess > 1 else action

    def within_travel(self, travelled: Action, action: Action) -> Action:
        """Return the action cut component by component so that the way since the beginning stays within its limits.

        Args:
            travelled: displacement since the beginning.
            action: of the next step.
        """
        upper = self.of(self.limits.travel_m, self.limits.travel_rad)
        lower = -upper
        if (z := self.index(Dof.Z)) is not None:
            lower[z] = -self.limits.down_m
        # Who is outside already, pushed by something else, may come back and not go farther out.
        room_up, room_down = np.maximum(upper - travelled, 0.0), np.minimum(lower - travelled, 0.0)
        return np.asarray(np.minimum(np.maximum(action, room_down), room_up))


def action_space(dof: str, limits: Limits | None = None) -> ActionSpace:
    """Return the action space of a value of ``dof``.

    Raises:
        ValueError: when there is no such set.
    """
    if dof not in DOF_SETS:
        raise ValueError(f"dof={dof}: expected one of {', '.join(DOF_SETS)}")
    return ActionSpace(DOF_SETS[dof], Limits() if limits is None else limits)


def twist(space: ActionSpace, action: Action, rate_hz: float) -> Float64[np.ndarray, "6"]:
    """Return the twist that carries out an action within one step, in meters and radians per second.

    >>> twist(ActionSpace((Dof.X, Dof.YAW)), np.array([0.01, 0.02]), 10.0)
    array([0.1, 0. , 0. , 0. , 0. , 0.2])
    """
    velocity: Float64[np.ndarray, 6] = space.basis @ action * rate_hz
    return velocity


def names(dofs: Sequence[Dof]) -> list[str]:
    """Return the names of degrees of freedom, as written to files."""
    return [str(dof) for dof in dofs]
