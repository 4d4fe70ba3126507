"""The rigid motion of a thing between two frames, found through its lines alone.

As :mod:`geoskill.geometry.rigid_map` with points: every motion that is tried takes the anchor, a line, onto its
counterpart, and another line onto its own; the one that most of the other lines agree with is taken. Lines have no
ends that correspond, and no direction, so both are tried either way round.
"""

from itertools import product
from typing import Final

import numpy as np
from jaxtyping import Bool, Float64, Int

MIN_SUPPORT: Final = 2
"""Lines beside the anchor that have to agree: with one, the motion is fixed."""
MIN_SINE: Final = 0.34
"""Lines at less than 20 degrees hardly fix a motion."""
MAX_TURN_SINE: Final = 0.10
"""Lines that agree are at less than 6 degrees, some standard deviations of two lines of 100 mm at 0.7 m from a D435."""
ASIDE_M: Final = 0.03
"""So far beside the anchor two motions are compared."""

Line = Float64[np.ndarray, "6"]


def anchored_line_motion(
    anchor: tuple[Line, Line],
    source: Float64[np.ndarray, "c 6"],
    target: Float64[np.ndarray, "c 6"],
    feature: Int[np.ndarray, " c"],
    tolerance_m: float,
) -> Float64[np.ndarray, "4 4"] | None:
    """Return the motion with the most support, or None with less than :data:`MIN_SUPPORT`.

    None, too, where another motion that differs by more than the tolerance at the anchor has as much.

    Args:
        anchor: a line before and after.
        source: possible matches of other lines, in meters, before.
        target: the same after.
        feature: number of the feature of each match; it may have several possible ones.
        tolerance_m: distance up to which a line agrees.
    """
    found: list[tuple[int, Float64[np.ndarray, "4 4"]]] = []
    for row in range(len(source)):
        for signs in product((1.0, -1.0), (1.0, -1.0)):
            motion = _through((anchor[0], source[row]), (anchor[1], target[row]), signs, tolerance_m)
            if motion is not None:
                agrees = lines_agree(source, target, motion, tolerance_m)
                found.append((len(np.unique(feature[agrees])), motion))
    best = max((support for support, _ in found), default=0)
    if best < MIN_SUPPORT:
        return None
    motions = [motion for support, motion in found if support == best]
    ends = anchor[0].reshape(2, 3)
    across = np.linalg.svd(ends[1:] - ends[:1])[2][1]
    beside = np.concatenate([ends, ends + ASIDE_M * across])  # turns about the anchor are seen beside it
    places = np.stack([beside @ motion[:3, :3].T + motion[:3, 3] for motion in motions])
    if np.linalg.norm(places - places[0], axis=2).max() > 2 * tolerance_m:
        return None
    return motions[0]


def lines_agree(
    source: Float64[np.ndarray, "c 6"],
    target: Float64[np.ndarray, "c 6"],
    motion: Float64[np.ndarray, "4 4"],
    tolerance_m: float,
) -> Bool[np.ndarray, " c"]:
    """Return which lines a motion takes onto their counterparts: in direction, place, and so that they overlap."""
    middles, along, halves = _parts(source)
    to_middles, to_along, to_halves = _parts(target)
    arms = middles @ motion[:3, :3].T + motion[:3, 3] - to_middles
    reach = (arms * to_along).sum(axis=1)
    off = np.linalg.norm(arms - reach[:, None] * to_along, axis=1)
    sine = np.linalg.norm(np.cross(along @ motion[:3, :3].T, to_along), axis=1)
    agrees: np.ndarray = (off <= tolerance_m) & (sine <= MAX_TURN_SINE) & (np.abs(reach) <= halves + to_halves)
    return agrees


def _through(
    before: tuple[Line, Line], after: tuple[Line, Line], signs: tuple[float, float], tolerance_m: float
) -> Float64[np.ndarray, "4 4"] | None:
    """Return the motion that takes two lines onto two, as directed, or None where they are not as far apart."""
    (middle, along, _), (to_middle, to_along, _) = _parts(np.stack(before)), _parts(np.stack(after))
    to_along = to_along * np.array(signs)[:, None]
    cosines = float(along[0] @ along[1]), float(to_along[0] @ to_along[1])
    if max(map(abs, cosines)) > np.sqrt(1 - MIN_SINE**2) or abs(cosines[0] - cosines[1]) > MAX_TURN_SINE:
        return None
    motion = np.eye(4)
    motion[:3, :3] = rotation = _axes(to_along) @ _axes(along).T
    # The two lines' offsets from their counterparts, across these, are least.
    across = np.stack([np.eye(3) - np.outer(own, own) for own in to_along])
    offsets = to_middle - middle @ rotation.T
    motion[:3, 3] = np.linalg.solve(across.sum(axis=0), np.einsum("nij,nj->i", across, offsets))
    left = np.linalg.norm(np.einsum("nij,nj->ni", across, offsets - motion[:3, 3]), axis=1)
    return motion if left.max() <= tolerance_m else None


def _parts(
    lines: Float64[np.ndarray, "c 6"],
) -> tuple[Float64[np.ndarray, "c 3"], Float64[np.ndarray, "c 3"], Float64[np.ndarray, " c"]]:
    """Return midpoints, unit directions and half lengths."""
    way = lines[:, 3:] - lines[:, :3]
    length = np.maximum(np.linalg.norm(way, axis=1), 1e-9)
    return (lines[:, :3] + lines[:, 3:]) / 2, way / length[:, None], length / 2


def _axes(directions: Float64[np.ndarray, "2 3"]) -> Float64[np.ndarray, "3 3"]:
    """Return a right-handed frame that is even to both directions: between them, and across both."""
    between = directions[0] + directions[1]
    across = np.cross(directions[0], directions[1])
    between, across = between / np.linalg.norm(between), across / np.linalg.norm(across)
    return np.stack([between, np.cross(across, between), across], axis=1)
