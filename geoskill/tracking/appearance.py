"""Whether a place still looks as it did: small patches of gray, compared by their correlation."""

import cv2
import numpy as np
from jaxtyping import Float32, UInt8

from geoskill.geometry.primitives import NodeType

SIDE_PX = 15
# Where on a segment, from its one end to its other.
SHARES = (0.25, 0.5, 0.75)
# Smallest correlation of two patches that show the same. Light and noise leave it above 0.9, and what passes before a
# place takes it below 0.5.
ALIKE = 0.85


def patches_at(
    picture: UInt8[np.ndarray, "height width"], node_type: NodeType, coordinates: tuple[float, ...]
) -> Float32[np.ndarray, "p side side"]:
    """Patches of a gray picture at a point, or at three points of a segment."""
    ends = np.reshape(coordinates, (-1, 2))
    places = ends if node_type is NodeType.POINT else [ends[0] + share * (ends[1] - ends[0]) for share in SHARES]
    patches = [cv2.getRectSubPix(picture, (SIDE_PX, SIDE_PX), (float(x), float(y))) for x, y in places]
    return np.asarray(patches, np.float32)


def are_alike(some: Float32[np.ndarray, "p side side"], others: Float32[np.ndarray, "p side side"]) -> bool:
    """Whether most of the patches correlate with their counterparts; one without any texture correlates with none."""
    own, other = (each - each.mean(axis=(1, 2), keepdims=True) for each in (some, others))
    norms = np.sqrt((own**2).sum(axis=(1, 2)) * (other**2).sum(axis=(1, 2)))
    correlation = (own * other).sum(axis=(1, 2)) / np.maximum(norms, 1e-6)
    return bool(np.mean(correlation >= ALIKE) > 0.5)
