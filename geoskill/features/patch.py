"""Gray patches around SIFT's keypoints, in their scale and direction, for a network that describes them itself."""

from dataclasses import replace
from typing import ClassVar, final

import numpy as np
from jaxtyping import Float32, UInt8

from geoskill.features.extractor import FeatureExtractor
from geoskill.features.feature_set import FeatureSet
from geoskill.features.keypoints import distinct_keypoints, keypoint_features
from geoskill.features.pyramid import sample_at
from geoskill.features.sift import REACH, sift_detector
from geoskill.geometry.primitives import NodeType

SIDE = 16
# Pixel centers over a square from -1 to 1.
TICKS = ((np.arange(SIDE) + 0.5) * 2 / SIDE - 1).astype(np.float32)


@final
class Patch(FeatureExtractor):
    """What SIFT would describe, as 16 by 16 gray pixels of zero mean and unit norm, row by row.

    The first pixel's row and column lie against the keypoint's direction; the columns go along it. A patch without any
    contrast is zero but for its first pixel.

    Args:
        contrast_threshold: see :class:`geoskill.features.sift.Sift`.
    """

    name: ClassVar[str] = "patch"
    node_type: ClassVar[NodeType] = NodeType.POINT
    descriptor_dim: ClassVar[int] = SIDE * SIDE
    has_arms: ClassVar[bool] = True
    patch_side: ClassVar[int | None] = SIDE

    def __init__(self, contrast_threshold: float = 0.01) -> None:
        self.contrast_threshold = contrast_threshold

    def extract(self, image: UInt8[np.ndarray, "height width"], limit: int | None = None) -> FeatureSet:
        """See :meth:`FeatureExtractor.extract`."""
        keypoints = distinct_keypoints(sift_detector(self.contrast_threshold).detect(image, None), limit)
        if not keypoints:
            return FeatureSet.empty(self.node_type, self.descriptor_dim)
        found = keypoint_features(keypoints, np.zeros((len(keypoints), self.descriptor_dim), np.float32), REACH)
        assert found.arms is not None
        patches = patches_along(image, found.geometry, found.arms)
        patches = patches - patches.mean(axis=1, keepdims=True)
        norms = np.linalg.norm(patches, axis=1, keepdims=True)
        flat = norms[:, 0] < 1e-3
        patches[flat], norms[flat] = np.eye(1, self.descriptor_dim, dtype=np.float32), 1.0
        return replace(found, descriptors=patches / norms)


def patches_along(
    image: UInt8[np.ndarray, "height width"],
    middles: Float32[np.ndarray, "n 2"],
    arms: Float32[np.ndarray, "n 2"],
) -> Float32[np.ndarray, "n s"]:
    """The gray values of a grid of 16 by 16 places around each of the middles.

    Args:
        image: gray.
        middles: in pixels.
        arms: from there to the middle of the patch's side, along its rows.
    """
    down = np.stack([-arms[:, 1], arms[:, 0]], axis=1)
    along, across = (each.reshape(-1, 1) for each in np.meshgrid(TICKS, TICKS))
    places = middles[:, None] + along * arms[:, None] + across * down[:, None]
    pixel = (2 / SIDE * np.linalg.norm(arms, axis=1)).astype(np.float32)
    return sample_at(image.astype(np.float32), places.astype(np.float32), pixel)
