"""From OpenCV's keypoints to feature sets."""

from collections.abc import Iterable, Sequence

import cv2
import numpy as np
from jaxtyping import Float32

from geoskill.features.feature_set import FeatureSet
from geoskill.geometry.primitives import NodeType

# Share of a keypoint's diameter within which another one is the same corner: about one pixel of the pyramid level that
# ORB found it on (its diameter is 31 of them), which is how far apart two levels place a corner.
SAME_CORNER = 0.05


def distinct_keypoints(keypoints: Iterable[cv2.KeyPoint], limit: int | None = None) -> list[cv2.KeyPoint]:
    """The strongest keypoint of every corner, strongest first, and no more of them than ``limit``.

    A detector reports a corner once for each orientation and each octave; such copies would fill the few places of a
    frame and join into instances whose control error is always zero.
    """
    # The key makes the order independent of the detector's threads.
    ordered = sorted(keypoints, key=lambda k: (-k.response, k.pt, k.size, k.angle))
    positions = np.array([k.pt for k in ordered], np.float32).reshape(-1, 2)
    radii = np.maximum(0.5, SAME_CORNER * np.array([k.size for k in ordered], np.float32))
    free = np.ones(len(ordered), bool)
    distinct: list[cv2.KeyPoint] = []
    for row, keypoint in enumerate(ordered):
        if len(distinct) == limit:
            break
        if free[row]:
            distinct.append(keypoint)
            distance = np.linalg.norm(positions - positions[row], axis=1)
            free &= distance > np.maximum(radii, radii[row])
    return distinct


def keypoint_features(
    keypoints: Sequence[cv2.KeyPoint], descriptors: Float32[np.ndarray, "n d"], reach: float
) -> FeatureSet:
    """A feature set of described keypoints in the order they have.

    Args:
        keypoints: with their diameters and directions.
        descriptors: theirs.
        reach: how far from the keypoint its descriptor looks, in diameters.
    """
    angles = np.radians(np.array([k.angle for k in keypoints], np.float32))  # from x toward y, which is down
    lengths = reach * np.array([k.size for k in keypoints], np.float32)
    return FeatureSet(
        NodeType.POINT,
        np.ascontiguousarray(descriptors, np.float32),
        np.array([k.pt for k in keypoints], np.float32).reshape(-1, 2),
        np.array([k.response for k in keypoints], np.float32),
        (lengths * np.stack([np.cos(angles), np.sin(angles)])).T.astype(np.float32),
    )
