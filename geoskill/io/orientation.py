"""Turning of decoded pictures as players show them, by the display matrix that the file stores."""

import av
import numpy as np
from av.sidedata.sidedata import SideData
from jaxtyping import Int, UInt8


def shown(frame: av.VideoFrame) -> UInt8[np.ndarray, "height width 3"]:
    """Return a decoded frame as RGB, turned and mirrored as its display matrix says."""
    picture = np.asarray(frame.to_ndarray(format="rgb24"), np.uint8)
    stored = frame.side_data.get("DISPLAYMATRIX")
    if not isinstance(stored, SideData):
        return picture
    return oriented(picture, np.frombuffer(bytes(stored), "=i4").reshape(3, 3))


def oriented(
    picture: UInt8[np.ndarray, "height width 3"], matrix: Int[np.ndarray, "3 3"]
) -> UInt8[np.ndarray, "height_out width_out 3"]:
    """Turn and mirror a picture by the nearest of the eight transformations that keep its pixels.

    Args:
        picture: as decoded.
        matrix: rows (a, b, u), (c, d, v), (x, y, w) of ISO/IEC 14496-12, 8.3.2: a pixel at (x, y) is shown at
            (a x + c y, b x + d y). Where all is zero, the picture stays as it is.
    """
    (a, b), (c, d) = matrix[:2, :2].tolist()
    if abs(b) + abs(c) > abs(a) + abs(d):
        picture, to_x, to_y = picture.transpose(1, 0, 2), c, b
    else:
        to_x, to_y = a, d
    return np.ascontiguousarray(picture[:: -1 if to_y < 0 else 1, :: -1 if to_x < 0 else 1])
