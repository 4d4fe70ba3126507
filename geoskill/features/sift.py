"""SIFT keypoints and descriptors (Lowe, "Distinctive image features from scale-invariant keypoints", IJCV 2004)."""

from typing import ClassVar, final

import cv2
import numpy as np
from jaxtyping import UInt8

from geoskill.features.extractor import FeatureExtractor
from geoskill.features.feature_set import FeatureSet
from geoskill.features.keypoints import distinct_keypoints, keypoint_features
from geoskill.geometry.primitives import NodeType

# In diameters: OpenCV describes 4 x 4 cells, each one and a half diameters wide.
SUPPORT_RADIUS = 3.0


@final
class Sift(FeatureExtractor):
    """OpenCV's SIFT, unit L2 norm, one keypoint per position.

    Args:
        contrast_threshold: the detector's threshold on the difference of Gaussians. Far below OpenCV's 0.04, because
            the pipeline keeps the strongest features anyway: the threshold only decides whether a dull picture has any.
        root: RootSIFT (Arandjelovic and Zisserman, CVPR 2012): the square root of the L1-normalized histogram.
    """

    name: ClassVar[str] = "sift"
    node_type: ClassVar[NodeType] = NodeType.POINT
    descriptor_dim: ClassVar[int] = 128
    has_orientation: ClassVar[bool] = True

    def __init__(self, *, contrast_threshold: float = 0.01, root: bool = False) -> None:
        self.contrast_threshold = contrast_threshold
        self.root = root

    def extract(self, image: UInt8[np.ndarray, "height width"], limit: int | None = None) -> FeatureSet:
        """Return the keypoints of a picture, highest score first; see :meth:`FeatureExtractor.extract`."""
        detector = sift_detector(self.contrast_threshold)
        detected = detector.detect(image, None)
        keypoints = distinct_keypoints(detected, limit)
        if not keypoints:
            return FeatureSet.empty(self.node_type, self.descriptor_dim)
        # OpenCV starts the pyramid at the finest octave of the keypoints to describe, which changes the descriptors by
        # rounding. One more keypoint, of the finest octave detected, makes them independent of the limit.
        finest = min(detected, key=_octave)
        _, histograms = detector.compute(image, [*keypoints, finest])
        descriptors = np.asarray(histograms, np.float32)[:-1]
        if self.root:
            descriptors = np.sqrt(descriptors / np.maximum(descriptors.sum(axis=1, keepdims=True), 1e-12))
        norms = np.linalg.norm(descriptors, axis=1, keepdims=True)
        return keypoint_features(keypoints, descriptors / np.maximum(norms, 1e-12), SUPPORT_RADIUS)


def sift_detector(contrast_threshold: float) -> cv2.SIFT:
    """Return OpenCV's detector, set to report positions in the picture's pixels."""
    # Without the precise upscale every position is a quarter of a pixel too far to the right and down.
    return cv2.SIFT.create(contrastThreshold=contrast_threshold, enable_precise_upscale=True)


def _octave(keypoint: cv2.KeyPoint) -> int:
    """Return the octave of the pyramid, -1 being the picture at twice its size; OpenCV packs it into the low byte."""
    byte = keypoint.octave & 0xFF
    return byte - 256 if byte > 127 else byte
