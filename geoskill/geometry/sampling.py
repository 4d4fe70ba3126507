"""Resizing of pictures, and bilinear interpolation of pictures and vector fields at pixel coordinates."""

import cv2
import numpy as np
from jaxtyping import Float32, UInt8

# cv2.remap accepts at most 32767 columns.
POINTS_PER_CALL = 30000


def sample_bilinear(
    field: Float32[np.ndarray, "height width *channels"], xy: Float32[np.ndarray, "*points 2"]
) -> Float32[np.ndarray, "..."]:
    """Return the values of a picture or field at points (``[*points, *channels]``), interpolated between four pixels.

    Depending on its version and the number of channels, OpenCV interpolates in steps of 1/32 pixel. Outside the picture
    the value of the nearest border pixel is returned.

    Args:
        field: one or more channels.
        xy: x and y of each point in pixels, (0, 0) being the center of the top left pixel; at least one point.

    >>> sample_bilinear(np.array([[0.0, 10.0]], np.float32), np.array([[0.25, 0.0], [9.0, 9.0]], np.float32))
    array([ 2.5, 10. ], dtype=float32)
    """
    rows = np.ascontiguousarray(xy, np.float32).reshape(1, -1, 2)
    blocks = [
        cv2.remap(  # type: ignore[call-overload]
            field, rows[:, first : first + POINTS_PER_CALL], None, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
        )
        for first in range(0, rows.shape[1], POINTS_PER_CALL)
    ]
    values: np.ndarray = np.concatenate(blocks, axis=1)
    return values.reshape(*xy.shape[:-1], *field.shape[2:])


def resized(picture: UInt8[np.ndarray, "_ _ *channels"], scale: float) -> UInt8[np.ndarray, "_ _ *channels"]:
    """Return a picture at another size, at least one pixel wide and high, each pixel the mean of those that it covers.

    >>> resized(np.array([[10, 20, 30, 40]], np.uint8), 0.5)
    array([[15, 35]], dtype=uint8)
    """
    height, width = picture.shape[:2]
    size = (max(1, round(width * scale)), max(1, round(height * scale)))
    return np.asarray(cv2.resize(picture, size, interpolation=cv2.INTER_AREA), np.uint8)
