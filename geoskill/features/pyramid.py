"""Values of a picture at many places, each averaged over a size of its own."""

import cv2
import numpy as np
from jaxtyping import Float32


def sample_at(
    picture: Float32[np.ndarray, "height width *channels"],
    places: Float32[np.ndarray, "n k 2"],
    size_px: Float32[np.ndarray, " n"],
) -> Float32[np.ndarray, "n k *channels"]:
    """The picture at ``k`` places of each of ``n`` features, interpolated in the level of its pyramid whose pixels are
    nearest to the feature's size. Beyond the picture is what is at its border.

    Args:
        picture: one or more channels.
        places: in pixels, x and y.
        size_px: over how many pixels is averaged; 1 and less is the picture itself.
    """
    values = np.zeros((*places.shape[:2], *picture.shape[2:]), np.float32)
    if len(places) == 0:
        return values
    level_of = np.log2(np.maximum(size_px, 1.0)).round().astype(np.int64)
    level = picture
    for number in range(int(level_of.max()) + 1):
        rows = np.flatnonzero(level_of == number)
        # A pixel of one level lies where every second one of the level below does.
        found = np.ascontiguousarray(places[rows] / 2**number, np.float32)
        if len(rows):
            values[rows] = cv2.remap(level, found, None, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)  # type: ignore[call-overload]
        if min(level.shape[:2]) > 2:
            level = np.asarray(cv2.pyrDown(level), np.float32)
        else:
            places = places * 2  # too small to be halved: the coarser levels are this one
    return values
