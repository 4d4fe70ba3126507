"""Pixel-patch descriptor: gray patches at SIFT's keypoints, in their scale and direction, as input for a network."""

from dataclasses import replace
from typing import ClassVar, final

import numpy as np
from jaxtyping import Float32, UInt8

from geoskill.features.extractor import FeatureExtractor
from geoskill.features.feature_set import FeatureSet
from geoskill.features.keypoints import distinct_keypoints, keypoint_features
from geoskill.features.pyramid import sample_at
from geoskill.features.sift import SUPPORT_RADIUS, sift_detector
from geoskill.geometry.primitives import NodeType

SIDE = 16
# Pixel centers over a square from -1 to 1.
TICKS = ((np.arange(SIDE) + 0.5) * 2 / SIDE - 1).astype(np.float32)


@final
class PixelPatch(FeatureExtractor):
    """The region that SIFT describes, as 16 x 16 gray pixels of zero mean and unit norm, row by row.

    Columns run along the keypoint's direction. A patch without contrast is zero except for its first pixel.

    Args:
        contrast_threshold: see :class:`geoskill.features.sift.Sift`.
    """

    name: ClassVar[str] = "patch"
    node_type: ClassVar[NodeType] = NodeType.POINT
    descriptor_dim: ClassVar[int] = SIDE * SIDE
    has_orientation: ClassVar[bool] = True
    patch_side: ClassVar[int | None] = SIDE

    def __init__(self, *, contrast_threshold: float = 0.01) -> None:
        self.contrast_threshold = contrast_threshold

    def extract(self, image: UInt8[np.ndarray, "height width"], limit: int | None = None) -> FeatureSet:
        """Return the keypoints of a picture, highest score first; see :meth:`FeatureExtractor.extract`."""
        keypoints = distinct_keypoints(sift_detector(self.contrast_threshold).detect(image, None), limit)
        if not keypoints:
            return FeatureSet.empty(self.node_type, self.descriptor_dim)
        undescribed = np.zeros((len(keypoints), self.descriptor_dim), np.float32)
        features = keypoint_features(keypoints, undescribed, SUPPORT_RADIUS)
        assert features.orientation_px is not None
        patches = sample_patches(image, features.geometry, features.orientation_px)
        patches = patches - patches.mean(axis=1, keepdims=True)
        norms = np.linalg.norm(patches, axis=1, keepdims=True)
        flat = norms[:, 0] < 1e-3
        patches[flat], norms[flat] = np.eye(1, self.descriptor_dim, dtype=np.float32), 1.0
        return replace(features, descriptors=patches / norms)


def sample_patches(
    image: UInt8[np.ndarray, "height width"],
    positions: Float32[np.ndarray, "n 2"],
    orientation_px: Float32[np.ndarray, "n 2"],
) -> Float32[np.ndarray, "n s"]:
    """Return the gray values of a grid of 16 x 16 samples around each position, row by row.

    Args:
        image: gray.
        positions: centers of the patches, in pixels.
        orientation_px: vectors from the center of a patch to the middle of a side, along its rows.
    """
    x_axis, y_axis = orientation_px, np.stack([-orientation_px[:, 1], orientation_px[:, 0]], axis=1)
    columns, rows = (ticks.reshape(-1, 1) for ticks in np.meshgrid(TICKS, TICKS))
    samples = positions[:, None] + columns * x_axis[:, None] + rows * y_axis[:, None]
    pixel_size = (2 / SIDE * np.linalg.norm(orientation_px, axis=1)).astype(np.float32)
    return sample_at(image.astype(np.float32), samples.astype(np.float32), pixel_size)
