"""Appearance of features: small gray patches, compared by normalized correlation."""

import cv2
import numpy as np
from jaxtyping import Float32, UInt8

from geoskill.geometry.primitives import NodeType

SIDE_PX = 15
# Positions of the patches on a segment, as fractions of its length.
SEGMENT_FRACTIONS = (0.25, 0.5, 0.75)
# Of the patches of an outline or an ellipse beside that at its center: the way from there to its corners.
OUTLINE_SHARE = 0.5
# Smallest correlation of two patches of the same surface (docs/experiments/switches.md).
MIN_CORRELATION = 0.85


def patches_at(
    picture: UInt8[np.ndarray, "height width"], node_type: NodeType, coordinates: tuple[float, ...]
) -> Float32[np.ndarray, "p side side"]:
    """Return the patch of a gray picture at a point, those at three points of a segment, or five within an outline.

    Args:
        picture: gray; its border is repeated outside.
        node_type: type of the feature.
        coordinates: of the feature, in pixels.
    """
    ends = np.reshape(coordinates, (-1, 2))
    if node_type is NodeType.POINT:
        positions = list(ends)
    elif node_type is not NodeType.LINE:
        middle = ends.mean(axis=0)
        positions = [middle, *(middle + OUTLINE_SHARE * (ends - middle))]
    else:
        positions = [ends[0] + fraction * (ends[1] - ends[0]) for fraction in SEGMENT_FRACTIONS]
    patches = [cv2.getRectSubPix(picture, (SIDE_PX, SIDE_PX), (float(x), float(y))) for x, y in positions]
    return np.asarray(patches, np.float32)


def matches(first: Float32[np.ndarray, "p side side"], second: Float32[np.ndarray, "p side side"]) -> bool:
    """Return whether most of the patches correlate with their counterparts.

    The correlation does not depend on brightness or contrast. A patch without texture correlates with nothing.
    """
    first, second = (patches - patches.mean(axis=(1, 2), keepdims=True) for patches in (first, second))
    norms = np.sqrt((first**2).sum(axis=(1, 2)) * (second**2).sum(axis=(1, 2)))
    correlation = (first * second).sum(axis=(1, 2)) / np.maximum(norms, 1e-6)
    return bool(np.mean(correlation >= MIN_CORRELATION) > 0.5)
