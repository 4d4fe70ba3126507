"""Sampling of a picture at many positions, each averaged over its own size."""

import cv2
import numpy as np
from jaxtyping import Float32

from geoskill.geometry.sampling import sample_bilinear


def sample_at(
    picture: Float32[np.ndarray, "height width *channels"],
    positions: Float32[np.ndarray, "n k 2"],
    size_px: Float32[np.ndarray, " n"],
) -> Float32[np.ndarray, "n k *channels"]:
    """Return the picture at ``k`` positions of each of ``n`` features, averaged over the feature's size.

    The values are interpolated in the level of the picture's pyramid whose pixels are closest to the size. Outside the
    picture, the border is repeated.

    Args:
        picture: one or more channels.
        positions: x and y in pixels.
        size_px: width of the average; up to 1 the picture itself is sampled.
    """
    values = np.zeros((*positions.shape[:2], *picture.shape[2:]), np.float32)
    if len(positions) == 0:
        return values
    level_of_feature = np.log2(np.maximum(size_px, 1.0)).round().astype(np.int64)
    level_picture = picture
    for level in range(int(level_of_feature.max()) + 1):
        rows = np.flatnonzero(level_of_feature == level)
        if len(rows):
            # Every second pixel of a level keeps its center in the next one.
            values[rows] = sample_bilinear(level_picture, (positions[rows] / 2**level).astype(np.float32))
        if min(level_picture.shape[:2]) > 2:
            level_picture = np.asarray(cv2.pyrDown(level_picture), np.float32)
        else:
            positions = positions * 2  # too small to be halved: all coarser levels are this one
    return values
