"""Corners (Shi and Tomasi, "Good features to track", CVPR 1994) with SIFT histograms of their surroundings."""

from typing import ClassVar, final

import cv2
import numpy as np
from jaxtyping import UInt8

from geoskill.features.extractor import FeatureExtractor
from geoskill.features.feature_set import FeatureSet
from geoskill.geometry.primitives import NodeType


@final
class Corners(FeatureExtractor):
    """OpenCV's corners, each described upright at one scale; the score is the smaller eigenvalue.

    Args:
        min_distance: pixels between two corners.
        patch_size: diameter in pixels of the keypoint that SIFT describes.
    """

    name: ClassVar[str] = "corners"
    node_type: ClassVar[NodeType] = NodeType.POINT
    descriptor_dim: ClassVar[int] = 128

    def __init__(self, min_distance: float = 5.0, patch_size: float = 12.0) -> None:
        self.min_distance = min_distance
        self.patch_size = patch_size

    def extract(self, image: UInt8[np.ndarray, "height width"], limit: int | None = None) -> FeatureSet:
        """See :meth:`FeatureExtractor.extract`."""
        everywhere = np.ones_like(image)
        corners, quality = cv2.goodFeaturesToTrackWithQuality(image, limit or 0, 0.01, self.min_distance, everywhere)
        if corners is None:  # a picture without corners
            return FeatureSet.empty(self.node_type, self.descriptor_dim)
        geometry = np.asarray(corners, np.float32).reshape(-1, 2)
        keypoints = [cv2.KeyPoint(float(x), float(y), self.patch_size, 0.0) for x, y in geometry]
        _, histograms = cv2.SIFT.create().compute(image, keypoints)
        norms = np.linalg.norm(histograms, axis=1, keepdims=True)
        descriptors = np.asarray(histograms / np.maximum(norms, 1e-12), np.float32)
        return FeatureSet(self.node_type, descriptors, geometry, np.asarray(quality, np.float32).reshape(-1))
