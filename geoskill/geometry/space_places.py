"""Places of points, lines and planes in space: moved rigidly, and compared as what their constraints know of them.

The ends of a line are wherever a detector ends it, so two lines agree when their carriers do.
"""

import numpy as np
from jaxtyping import Float, Float64

from geoskill.geometry.primitives import NodeType


def moved_place(
    kind: NodeType, place: Float[np.ndarray, " s"], motion: Float64[np.ndarray, "4 4"]
) -> Float64[np.ndarray, " s"]:
    """Return a feature after a rigid motion X' = R X + t, given as a matrix.

    >>> shift = np.eye(4)
    >>> shift[2, 3] = 0.25
    >>> moved_place(NodeType.PLANE, np.array([0.0, 0.0, -1.0, 0.5]), shift).tolist()
    [0.0, 0.0, -1.0, 0.75]
    """
    rotation, translation = motion[:3, :3], motion[:3, 3]
    if kind is NodeType.PLANE:
        normal = rotation @ place[:3]
        return np.append(normal, place[3] - normal @ translation)
    return np.asarray((place.reshape(-1, 3) @ rotation.T + translation).ravel(), np.float64)


def distances_in_space(
    kind: NodeType, places: Float[np.ndarray, "n s"], place: Float[np.ndarray, " s"]
) -> Float64[np.ndarray, " n"]:
    """Return how far points are from one, or the ends of one line from the carriers of lines, in meters.

    Args:
        kind: a point or a line.
        places: of features of this type.
        place: of the one.
    """
    if kind is NodeType.POINT:
        return np.asarray(np.linalg.norm(places - place, axis=1), np.float64)
    starts, along = places[:, None, :3], (places[:, 3:] - places[:, :3])[:, None]
    arms = place.reshape(1, 2, 3) - starts
    areas = np.linalg.norm(np.cross(arms, np.broadcast_to(along, arms.shape)), axis=2)
    return np.asarray((areas / np.maximum(np.linalg.norm(along, axis=2), 1e-9)).max(axis=1), np.float64)


def shift_between(
    kind: NodeType, before: Float[np.ndarray, " s"], after: Float[np.ndarray, " s"]
) -> Float64[np.ndarray, "3"]:
    """Return the smallest translation that takes a feature to where it is now, as far as it did not turn, in meters."""
    if kind is NodeType.PLANE:
        return np.asarray((before[3] - after[3]) * after[:3], np.float64)
    way = after.reshape(-1, 3).mean(axis=0) - before.reshape(-1, 3).mean(axis=0)
    if kind is NodeType.LINE:
        along = (after[3:] - after[:3]) / max(float(np.linalg.norm(after[3:] - after[:3])), 1e-9)
        way = way - (way @ along) * along
    return np.asarray(way, np.float64)


def laid_over(place: Float[np.ndarray, "6"], present: Float[np.ndarray, "6"]) -> Float64[np.ndarray, "6"]:
    """Return a segment on the carrier of ``place``, as long as ``present`` is and as near to it as ``place`` reaches.

    Detectors end a segment elsewhere in every frame, which says nothing about the way that is left.
    """
    start, along = place[:3], place[3:] - place[:3]
    size = max(float(np.linalg.norm(along)), 1e-9)
    middle = (present[:3] + present[3:]) / 2
    share = float(np.clip((middle - start) @ along / size**2, 0.0, 1.0))
    arm = along / size * float(np.linalg.norm(present[3:] - present[:3])) / 2
    center = start + share * along
    return np.concatenate([center - arm, center + arm])
