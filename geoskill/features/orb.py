"""ORB keypoints and binary descriptors (Rublee et al., ICCV 2011)."""

from typing import ClassVar, final

import cv2
import numpy as np
from jaxtyping import UInt8

from geoskill.features.extractor import FeatureExtractor
from geoskill.features.feature_set import FeatureSet
from geoskill.features.keypoints import distinct_keypoints, keypoint_features
from geoskill.geometry.primitives import NodeType

# In diameters: a keypoint's diameter is that of the disk whose pixels are compared.
SUPPORT_RADIUS = 0.5


@final
class Orb(FeatureExtractor):
    """OpenCV's ORB, its 256 bits as ±1/sqrt(256), so that a dot product is 1 - 2/256 of the Hamming distance.

    A picture whose shorter side has fewer than 63 pixels has no keypoint, because the detector leaves out a border of
    31 pixels.

    Args:
        candidates: number of keypoints requested from the detector, before the pipeline keeps the strongest.
        fast_threshold: threshold of the corner detector, in gray levels.
    """

    name: ClassVar[str] = "orb"
    node_type: ClassVar[NodeType] = NodeType.POINT
    descriptor_dim: ClassVar[int] = 256
    has_orientation: ClassVar[bool] = True

    def __init__(self, *, candidates: int = 2000, fast_threshold: int = 10) -> None:
        self.candidates = candidates
        self.fast_threshold = fast_threshold

    def extract(self, image: UInt8[np.ndarray, "height width"], limit: int | None = None) -> FeatureSet:
        """Return the keypoints of a picture, highest score first; see :meth:`FeatureExtractor.extract`."""
        detector = cv2.ORB.create(nfeatures=self.candidates, fastThreshold=self.fast_threshold)
        # Smaller pictures have no keypoint, and OpenCV's pyramid fails on pictures of a few pixels.
        if min(image.shape) <= 2 * detector.getEdgeThreshold():
            return FeatureSet.empty(self.node_type, self.descriptor_dim)
        detected, packed = detector.detectAndCompute(image, None)
        if not detected:
            return FeatureSet.empty(self.node_type, self.descriptor_dim)
        factor = detector.getScaleFactor()
        height, width = image.shape
        corrected = [_in_image_pixels(k, row, (height, width), factor) for row, k in enumerate(detected)]
        keypoints = distinct_keypoints(corrected, limit)
        bits = np.unpackbits(np.asarray(packed, np.uint8)[[k.class_id for k in keypoints]], axis=1)
        descriptors = (2 * bits.astype(np.float32) - 1) / np.sqrt(np.float32(bits.shape[1]))
        return keypoint_features(keypoints, descriptors, SUPPORT_RADIUS)


def _in_image_pixels(keypoint: cv2.KeyPoint, row: int, shape: tuple[int, int], scale_factor: float) -> cv2.KeyPoint:
    """Return the keypoint at its true position in the picture; its ``class_id`` becomes the row of its descriptor.

    OpenCV multiplies the position in a pyramid level by the nominal scale. That ignores that a resize moves pixel
    centers and that a level has a whole number of pixels: up to 2 px too far to the left and up.
    """
    scale = scale_factor**keypoint.octave
    x, y = (
        (round(nominal / scale) + 0.5) * side / round(side / scale) - 0.5
        for nominal, side in zip(keypoint.pt, shape[::-1], strict=True)
    )
    return cv2.KeyPoint(x, y, keypoint.size, keypoint.angle, keypoint.response, keypoint.octave, row)
