"""The rigid motion of a thing between two frames, found through one of its points and what agrees with it.

As :mod:`geoskill.geometry.anchored_map` in the picture: features around the anchor may be matched wrongly, or belong to
something else that moved otherwise, such as a background with more features. Every motion that is tried takes the
anchor to its counterpart; the one that most of the other features agree with is taken. Nothing is drawn at random.
"""

from itertools import combinations
from typing import Final

import numpy as np
from jaxtyping import Float64, Int

MIN_SUPPORT: Final = 3
"""Features beside the anchor that have to agree: two fix the rotation."""
MAX_NEAR: Final = 24
"""Matches of which pairs are tried, those nearest to the anchor."""
MIN_AREA_M2: Final = 5e-5
"""Twice the area of the triangle of the anchor and a pair: a smaller one hardly fixes a rotation."""


def anchored_motion(
    anchor: tuple[Float64[np.ndarray, "3"], Float64[np.ndarray, "3"]],
    source: Float64[np.ndarray, "c 3"],
    target: Float64[np.ndarray, "c 3"],
    feature: Int[np.ndarray, " c"],
    tolerance_m: float,
) -> Float64[np.ndarray, "4 4"] | None:
    """Return the motion with the most support, or None with less than :data:`MIN_SUPPORT`.

    Args:
        anchor: a point before and after.
        source: possible matches of other features, in meters, before.
        target: the same after.
        feature: number of the feature of each match; it may have several possible ones.
        tolerance_m: distance up to which a feature agrees.
    """
    before, after = anchor
    arms, moved_arms = source - before, target - after
    lengths = np.linalg.norm(arms, axis=1), np.linalg.norm(moved_arms, axis=1)
    rigid = np.abs(lengths[0] - lengths[1]) <= tolerance_m
    near = np.flatnonzero(rigid)[np.argsort(lengths[0][rigid], kind="stable")][:MAX_NEAR]
    pairs = np.array(list(combinations(near.tolist(), 2)), np.int64).reshape(-1, 2)
    first, second = pairs.T
    apart = np.linalg.norm(source[first] - source[second], axis=1)
    apart_after = np.linalg.norm(target[first] - target[second], axis=1)
    area = np.linalg.norm(np.cross(arms[first], arms[second]), axis=1)
    usable = (np.abs(apart - apart_after) <= tolerance_m) & (area >= MIN_AREA_M2)
    pairs = pairs[usable & (feature[first] != feature[second])]
    if len(pairs) == 0:
        return None
    first, second = pairs.T
    frames = _frames(arms[first], arms[second]), _frames(moved_arms[first], moved_arms[second])
    rotations = frames[1] @ frames[0].transpose(0, 2, 1)
    residual = np.linalg.norm(np.einsum("hij,cj->hci", rotations, arms) - moved_arms, axis=2)
    agrees = residual <= tolerance_m
    support = np.stack([agrees[:, feature == own].any(axis=1) for own in np.unique(feature)], axis=1).sum(axis=1)
    best = int(support.argmax())
    if support[best] < MIN_SUPPORT:
        return None
    inliers = agrees[best]
    return fitted_motion(np.vstack([source[inliers], before]), np.vstack([target[inliers], after]))


def fitted_motion(source: Float64[np.ndarray, "n 3"], target: Float64[np.ndarray, "n 3"]) -> Float64[np.ndarray, "4 4"]:
    """Return the rigid motion of least squares ("A solution for the best rotation", Kabsch, 1976), as a matrix."""
    middle, moved_middle = source.mean(axis=0), target.mean(axis=0)
    u, _, v = np.linalg.svd((target - moved_middle).T @ (source - middle))
    sign = np.diag([1.0, 1.0, np.sign(np.linalg.det(u @ v))])
    motion = np.eye(4)
    motion[:3, :3] = u @ sign @ v
    motion[:3, 3] = moved_middle - motion[:3, :3] @ middle
    return motion


def _frames(first: Float64[np.ndarray, "h 3"], second: Float64[np.ndarray, "h 3"]) -> Float64[np.ndarray, "h 3 3"]:
    """Return right-handed frames, one axis along the first vector and one at right angles to both."""
    along = first / np.linalg.norm(first, axis=1, keepdims=True)
    across = np.cross(first, second)
    across = across / np.linalg.norm(across, axis=1, keepdims=True)
    frames: np.ndarray = np.stack([along, np.cross(across, along), across], axis=2)
    return frames
