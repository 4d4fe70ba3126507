"""Conversion of OpenCV's keypoints to feature sets."""

from collections.abc import Iterable, Sequence

import cv2
import numpy as np
from jaxtyping import Float32

from geoskill.features.feature_set import FeatureSet
from geoskill.geometry.primitives import NodeType

# Keypoints closer than this, in diameters, are the same corner. It is about one pixel of the pyramid level on which ORB
# found it (a diameter is 31 of them): two levels place a corner that far apart.
SAME_CORNER_DIAMETERS = 0.05


def distinct_keypoints(keypoints: Iterable[cv2.KeyPoint], limit: int | None = None) -> list[cv2.KeyPoint]:
    """Return the strongest keypoint of every corner, strongest first, at most ``limit`` of them.

    Detectors report a corner once for each orientation and octave. Such duplicates would use up a frame's features, and
    form instances whose control error is always zero.
    """
    # The key makes the order independent of the detector's threads.
    ordered = sorted(keypoints, key=lambda k: (-k.response, k.pt, k.size, k.angle))
    positions = np.array([k.pt for k in ordered], np.float32).reshape(-1, 2)
    radii = np.maximum(0.5, SAME_CORNER_DIAMETERS * np.array([k.size for k in ordered], np.float32))
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
    keypoints: Sequence[cv2.KeyPoint], descriptors: Float32[np.ndarray, "n d"], support_radius: float
) -> FeatureSet:
    """Return the feature set of described keypoints, in the same order.

    Args:
        keypoints: with diameters and directions.
        descriptors: one row for each keypoint.
        support_radius: distance from a keypoint to the edge of the described region, in diameters.
    """
    angles = np.radians(np.array([k.angle for k in keypoints], np.float32))  # from x toward y, which is down
    radii_px = support_radius * np.array([k.size for k in keypoints], np.float32)
    return FeatureSet(
        NodeType.POINT,
        np.ascontiguousarray(descriptors, np.float32),
        np.array([k.pt for k in keypoints], np.float32).reshape(-1, 2),
        np.array([k.response for k in keypoints], np.float32),
        (radii_px * np.stack([np.cos(angles), np.sin(angles)])).T.astype(np.float32),
    )
