"""ORB keypoints and binary descriptors (Rublee et al., ICCV 2011)."""

from typing import ClassVar, final

import cv2
import numpy as np
from jaxtyping import UInt8

from geoskill.features.extractor import FeatureExtractor
from geoskill.features.feature_set import FeatureSet
from geoskill.features.keypoints import distinct_keypoints, keypoint_features
from geoskill.geometry.primitives import NodeType


@final
class Orb(FeatureExtractor):
    """OpenCV's ORB; its 256 bits become ±1/sqrt(256), so that a dot product is one minus twice the Hamming distance.

    Args:
        candidates: keypoints asked of the detector before the pipeline keeps the strongest.
        fast_threshold: the corner detector's threshold in grey levels.
    """

    node_type: ClassVar[NodeType] = NodeType.POINT
    descriptor_dim: ClassVar[int] = 256

    def __init__(self, candidates: int = 2000, fast_threshold: int = 10) -> None:
        self.candidates = candidates
        self.fast_threshold = fast_threshold

    def extract(self, image: UInt8[np.ndarray, "height width"]) -> FeatureSet:
        """See :meth:`FeatureExtractor.extract`."""
        detector = cv2.ORB.create(nfeatures=self.candidates, fastThreshold=self.fast_threshold)
        keypoints = distinct_keypoints(detector.detect(image, None))
        keypoints, packed = detector.compute(image, keypoints)
        if not keypoints:
            return FeatureSet.empty(self.node_type, self.descriptor_dim)
        bits = np.unpackbits(np.asarray(packed, np.uint8), axis=1).astype(np.float32)
        return keypoint_features(keypoints, (2.0 * bits - 1.0) / np.sqrt(np.float32(self.descriptor_dim)))
