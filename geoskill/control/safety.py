"""What may go to the actor: never more than the limits, never out of the workspace, never a value that is no number."""

from collections.abc import Sequence
from typing import Final

import numpy as np

from geoskill.control.action import Action, ActionSpace
from geoskill.control.rows import Constraint

FAR_PX: Final = 1e6
"""Coordinates beyond are no pixels."""
IMPLAUSIBLE: Final = 10.0
"""Steps at the limit in one frame, beyond which a report is wrong."""


def safe_action(space: ActionSpace, travelled: Action, action: Action) -> Action:
    """Return the action within the limits of a step and of the way; zeros where it is not finite.

    Args:
        space: what is commanded, with its limits.
        travelled: displacement since the beginning.
        action: what is asked for.
    """
    if not np.isfinite(action).all() or not np.isfinite(travelled).all():
        return np.zeros(len(space.dofs))
    return space.limited(space.within_travel(travelled, space.limited(action)))


def usable(constraint: Constraint, size: tuple[int, int], min_confidence: float) -> bool:
    """Return whether a constraint may drive: confident, finite, and with a node of each kind within the picture.

    Args:
        constraint: as selected.
        size: width and height of its picture, pixels.
        min_confidence: smallest confidence.
    """
    if not constraint.confidence >= min_confidence:  # so that a confidence that is no number is none
        return False
    if constraint.target is not None and not (np.abs(constraint.target) < FAR_PX).all():
        return False
    width, height = size
    for node in constraint.nodes:
        points = node.reshape(-1, 2)
        if not (np.abs(points) < FAR_PX).all():
            return False
        center = points.mean(axis=0)
        if not (-0.5 <= center[0] <= width - 0.5 and -0.5 <= center[1] <= height - 0.5):
            return False
    return any(constraint.carried) and not all(constraint.carried)


def way_back(way: Sequence[Action], space: ActionSpace, meters: float) -> list[Action]:
    """Return the last actions reversed, as many as bring the actor back by a distance.

    Args:
        way: actions in the order in which they were carried out.
        space: what is commanded.
        meters: how far to go back.
    """
    back: list[Action] = []
    gone = 0.0
    for action in reversed(way):
        if gone >= meters:
            break
        back.append(-action)
        gone += float(np.linalg.norm((space.basis @ action)[:3]))
    return back


def plausible(space: ActionSpace, acted: Action | None) -> Action | None:
    """Return a reported displacement, or None for one that no actor with these limits can have carried out."""
    if acted is None or acted.shape != space.step.shape:
        return None
    return acted if bool((np.abs(acted) <= IMPLAUSIBLE * space.step).all()) else None
