"""Straight segments by the Line Segment Detector.

R. Grompone von Gioi, J. Jakubowicz, J.-M. Morel and G. Randall, "LSD: a line segment detector", Image Processing On
Line 2 (2012), as OpenCV implements it.
"""

import cv2
import numpy as np
from jaxtyping import Float32, UInt8

from geoskill.errors import InputError

# The paper's: the picture is first reduced to this scale, against staircase artifacts.
DETECTION_SCALE = 0.8
# OpenCV divides coordinates by the scale as if (0, 0) were the corner of the first pixel, not its center: its segments
# are 0.125 px too close to the origin (docs/experiments/features.md).
CENTER_SHIFT_PX = 0.5 / DETECTION_SCALE - 0.5


def detect_segments(
    image: UInt8[np.ndarray, "height width"], min_length: float
) -> tuple[Float32[np.ndarray, "n 4"], Float32[np.ndarray, " n"]]:
    """Return segments ``[x1, y1, x2, y2]`` in pixels and their lengths in pixels, longest first.

    The length serves as score: a long edge is detected again more reliably than a short one, and its length does not
    depend on the light. End points may lie up to a pixel outside the picture; their order carries no meaning. One edge
    may be reported as several segments.

    Args:
        image: gray; a picture without pixels or without an edge has no segment.
        min_length: in pixels; shorter segments, and all under one pixel, are left out.

    Raises:
        InputError: when this build of OpenCV has no Line Segment Detector (4.1.0 to 4.5.3 have none).
        ValueError: when the image is not two-dimensional of 8-bit numbers.
    """
    if image.ndim != 2 or image.dtype != np.uint8:
        raise ValueError(f"image has shape {image.shape} and type {image.dtype}; expected [height, width] of uint8")
    detected = None
    if image.size > 0:
        try:
            detector = cv2.createLineSegmentDetector(cv2.LSD_REFINE_STD, DETECTION_SCALE)
        except (AttributeError, cv2.error) as error:
            raise InputError(
                f"OpenCV {cv2.__version__} has no Line Segment Detector; expected version 4.5.4 or later"
            ) from error
        detected = detector.detect(np.ascontiguousarray(image))[0]
    if detected is None:
        return np.zeros((0, 4), np.float32), np.zeros(0, np.float32)
    # OpenCV 5 returns [n, 4], OpenCV 4 [n, 1, 4].
    segments = np.asarray(detected, np.float32).reshape(-1, 4) + np.float32(CENTER_SHIFT_PX)
    lengths = np.hypot(segments[:, 2] - segments[:, 0], segments[:, 3] - segments[:, 1])
    order = np.argsort(-lengths, kind="stable")
    order = order[lengths[order] >= max(min_length, 1.0)]
    return segments[order], lengths[order]
