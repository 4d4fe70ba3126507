"""Jacobians of the error itself, estimated by Broyden's update: the usual way, as a baseline.

Each slot (member, rank, camera) keeps the Jacobian of whatever association it holds; when another one is selected, the
Jacobian is wrong. Source: Jägersand, 1995; Broyden, 1965.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Final, final

import numpy as np
from jaxtyping import Float64

from geoskill.control.action import Action, ActionSpace
from geoskill.control.rows import Row

BETA: Final = 0.2
MIN_SHARE: Final = 0.7
"""Of the limit of a step; noise spoils what a smaller step says."""

Slot = tuple[str, int, int]


def updated(
    jacobian: Float64[np.ndarray, "d n"], change: Float64[np.ndarray, " d"], action: Action, beta: float
) -> Float64[np.ndarray, "d n"]:
    """Return the Jacobian after a change of the error: ``J + beta (de - J dq) dq' / dq' dq``.

    With beta = 1 it explains the change exactly, and differs least from before of all that do.

    >>> updated(np.zeros((1, 2)), np.array([3.0]), np.array([0.5, 0.0]), 1.0)
    array([[6., 0.]])
    """
    square = float(action @ action)
    if square == 0:
        return jacobian
    return jacobian + beta * np.outer(change - jacobian @ action, action) / square


def forgetting(
    jacobian: Float64[np.ndarray, "d n"],
    covariance: Float64[np.ndarray, "n n"],
    change: Float64[np.ndarray, " d"],
    action: Action,
    memory: float,
) -> tuple[Float64[np.ndarray, "d n"], Float64[np.ndarray, "n n"]]:
    """Return Jacobian and covariance after recursive least squares, older steps counting ``memory`` times less."""
    gain = covariance @ action / (memory + action @ covariance @ action)
    jacobian = jacobian + np.outer(change - jacobian @ action, gain)
    return jacobian, (covariance - np.outer(gain, action @ covariance)) / memory


@final
@dataclass(frozen=True, eq=False)
class SlotJacobians:
    """The Jacobians of all slots, and their last errors.

    Attributes:
        jacobians: by slot.
        errors: of the last frame, by slot.
    """

    jacobians: Mapping[Slot, Float64[np.ndarray, "d n"]] = field(default_factory=dict)
    errors: Mapping[Slot, Float64[np.ndarray, " d"]] = field(default_factory=dict)

    def advanced(self, rows: Sequence[Row], action: Action, space: ActionSpace, probing: bool) -> "SlotJacobians":
        """Return the Jacobians after an action.

        Args:
            rows: of this frame.
            action: carried out since the last one.
            space: what is commanded.
            probing: whether it was a probing move, which is believed.
        """
        scaled = action / space.step
        jacobians, errors = dict(self.jacobians), dict(self.errors)
        for row in rows:
            slot = row.constraint.slot
            own = jacobians.get(slot, np.zeros((len(row.error), len(action))))
            large = float(np.abs(scaled).max()) > MIN_SHARE
            if slot in self.errors and self.errors[slot].shape == row.error.shape and (probing or large):
                own = updated(own, row.error - self.errors[slot], scaled, 1.0 if probing else BETA)
            jacobians[slot], errors[slot] = own, row.error
        return SlotJacobians(jacobians, errors)

    def applied(self, rows: Sequence[Row], space: ActionSpace) -> list[Row]:
        """Return the rows with these Jacobians in place of their own."""
        return [replace(row, jacobian=self.jacobians[row.constraint.slot] / space.step) for row in rows]
