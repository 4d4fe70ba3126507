"""From OpenCV's keypoints to feature sets."""

from collections.abc import Iterable, Sequence

import cv2
import numpy as np
from jaxtyping import Float32

from geoskill.features.feature_set import FeatureSet
from geoskill.geometry.primitives import NodeType


def distinct_keypoints(keypoints: Iterable[cv2.KeyPoint]) -> list[cv2.KeyPoint]:
    """The strongest keypoint of every pixel, strongest first.

    A detector reports a corner once for each orientation and each octave; such copies would fill the few places of a
    frame and join into instances whose control error is always zero.
    """
    best: dict[tuple[int, int], cv2.KeyPoint] = {}
    # The key makes the order independent of the detector's threads.
    for keypoint in sorted(keypoints, key=lambda k: (-k.response, k.pt, k.size, k.angle)):
        best.setdefault((round(keypoint.pt[0]), round(keypoint.pt[1])), keypoint)
    return list(best.values())


def keypoint_features(keypoints: Sequence[cv2.KeyPoint], descriptors: Float32[np.ndarray, "n d"]) -> FeatureSet:
    """A feature set of described keypoints in the order they have."""
    return FeatureSet(
        NodeType.POINT,
        np.ascontiguousarray(descriptors, np.float32),
        np.array([k.pt for k in keypoints], np.float32).reshape(-1, 2),
        np.array([k.response for k in keypoints], np.float32),
    )
