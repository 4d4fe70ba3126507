"""Names of the rigid motions that constraints leave free, from the null space of their Jacobian.

A motion is a twist ``[v, w]`` about a point G, in meters and radians. Translations come first: what is left of the null
space is described by its rotations, made orthogonal to the free translations, each about an axis in space, with a pitch
where it is a screw.
"""

import math
from collections.abc import Mapping
from typing import Final

import numpy as np
from jaxtyping import Float64

Vector = Float64[np.ndarray, "3"]
NAMED: Final = 0.9
"""Cosine from which on a direction has another's name."""
PITCH_M: Final = 0.005
"""Advance per radian below which a screw is a rotation."""
THROUGH_M: Final = 0.005
"""Distance within which an axis goes through a point."""
TOLERANCE: Final = 1e-4
"""Singular value over the largest below which a direction is free."""


def null_space(matrix: Float64[np.ndarray, "r c"], tolerance: float = TOLERANCE) -> Float64[np.ndarray, "c f"]:
    """Return an orthonormal basis of what a matrix takes to zero."""
    if matrix.shape[0] == 0:
        return np.eye(matrix.shape[1])
    _, values, rows = np.linalg.svd(matrix)
    rank = int((values > tolerance * max(float(values.max(initial=0.0)), 1e-12)).sum())
    return np.asarray(rows[rank:].T)


def name_free_motions(
    jacobian: Float64[np.ndarray, "r 6"],
    grip: Vector,
    directions: Mapping[str, Vector],
    points: Mapping[str, Vector],
) -> tuple[str, ...]:
    """Return a name for each free motion, the translations first.

    Args:
        jacobian: of all rows with respect to the twist, columns in comparable units.
        grip: about which the twist turns, meters.
        directions: unit vectors that have names.
        points: that have names, for axes that go through them.
    """
    shifts = null_space(jacobian[:, :3])
    names = [f"translation along {name_of(own, directions)}" for own in _in_order(shifts, directions)]
    free = null_space(jacobian)
    turns = free.copy()
    turns[:3] -= shifts @ (shifts.T @ turns[:3])
    # Of the null space, what is left after its translations; its rotations tell it apart.
    _, values, rows = np.linalg.svd(turns[3:]) if turns.shape[1] else (None, np.zeros(0), np.zeros((0, 0)))
    for own in rows[: int((values > 1e-6).sum())]:
        motion = turns @ own
        names.append(name_rotation(motion / np.linalg.norm(motion[3:]), grip, directions, points))
    return tuple(names)


def name_rotation(
    motion: Float64[np.ndarray, "6"], grip: Vector, directions: Mapping[str, Vector], points: Mapping[str, Vector]
) -> str:
    """Return the name of a twist with a unit rotation: its axis, and the point that it goes through."""
    shift, turn = motion[:3], motion[3:]
    through = grip + np.cross(turn, shift)
    pitch = float(turn @ shift)
    kind = "rotation" if abs(pitch) < PITCH_M else "screw"
    near = {name: float(np.linalg.norm(np.cross(point - through, turn))) for name, point in points.items()}
    where = min(near, key=lambda name: near[name], default=None)
    place = f" through {where}" if where is not None and near[where] < THROUGH_M else ""
    return f"{kind} about {name_of(turn, directions)}{place}"


def name_of(direction: Vector, directions: Mapping[str, Vector]) -> str:
    """Return the name of the nearest named direction, or the direction itself.

    >>> name_of(np.array([0.0, 0.1, -1.0]), {"the vertical": np.array([0.0, 0.0, 1.0])})
    'the vertical'
    >>> name_of(np.array([0.6, 0.8, 0.0]), {"the vertical": np.array([0.0, 0.0, 1.0])})
    '(0.60, 0.80, 0.00)'
    """
    unit = direction / np.linalg.norm(direction)
    cosines = {name: abs(float(unit @ own)) for name, own in directions.items()}
    best = max(cosines, key=lambda name: cosines[name], default=None)
    if best is not None and cosines[best] > NAMED:
        return best
    # The sign of an axis says nothing.
    largest = int(np.argmax(np.abs(unit)))
    unit = unit * math.copysign(1.0, float(unit[largest])) + 0.0
    return f"({unit[0]:.2f}, {unit[1]:.2f}, {unit[2]:.2f})"


def _in_order(basis: Float64[np.ndarray, "3 f"], directions: Mapping[str, Vector]) -> list[Vector]:
    """Return directions that span the same space, named ones that lie in it first."""
    if basis.shape[1] == 3:
        return [np.asarray(own) for own in np.eye(3)]
    chosen: list[Vector] = []
    for smallest, candidates in ((NAMED, [basis @ (basis.T @ own) for own in directions.values()]), (1e-6, basis.T)):
        for candidate in candidates:
            left = candidate - sum((own * float(own @ candidate) for own in chosen), np.zeros(3))
            size = float(np.linalg.norm(left))
            if size > smallest and len(chosen) < basis.shape[1]:
                chosen.append(left / size)
    return chosen
