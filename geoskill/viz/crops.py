"""Pictures of the features of a task definition."""

import math
from pathlib import Path
from typing import Final

import cv2
import numpy as np
from jaxtyping import UInt8

from geoskill.geometry.primitives import NodeType
from geoskill.io.atomic import atomic_open
from geoskill.skill.association import Node
from geoskill.skill.crops import Crop
from geoskill.viz.drawing import CASING, TOP_COLOR, draw_disc, draw_polyline
from geoskill.viz.marks import outline

MIN_SIDE_PX: Final = 192
"""Smaller crops are enlarged to at least this."""
RING_RATIO: Final = 0.08
"""Radius of the ring around a point, as a share of the side; what is in it stays visible."""


def draw_crop(crop: Crop, node: Node) -> UInt8[np.ndarray, "side side 3"]:
    """Return a crop, enlarged, with a ring around the point or a line beside the whole of the line that it shows; RGB.

    Args:
        crop: part of a frame.
        node: a node in it, in pixels of the frame.
    """
    factor = max(1, math.ceil(MIN_SIDE_PX / len(crop.image)))
    enlarged = cv2.resize(crop.image, None, fx=factor, fy=factor, interpolation=cv2.INTER_CUBIC)
    canvas = np.ascontiguousarray(enlarged, np.uint8)
    xy = np.reshape(np.asarray(node.coordinates, np.float64), (-1, 2)) - (crop.left, crop.top)
    xy = factor * (xy + 0.5) - 0.5
    unit = max(1, round(len(canvas) / MIN_SIDE_PX))
    for pen, width in ((CASING, 4 * unit), (TOP_COLOR, 2 * unit)):
        if node.node_type is NodeType.POINT:
            draw_disc(canvas, xy[0], RING_RATIO * len(canvas), pen, width)
        elif node.node_type is not NodeType.LINE:
            draw_polyline(canvas, outline(node.node_type, xy), pen, width, closed=True)
        else:
            along = xy[1] - xy[0]
            across = np.array([-along[1], along[0]]) / max(float(np.linalg.norm(along)), 1e-9)
            for side in (-1, 1):
                draw_polyline(canvas, xy + side * RING_RATIO / 2 * len(canvas) * across, pen, width)
    return canvas


def write_picture(path: Path, image: UInt8[np.ndarray, "height width 3"]) -> None:
    """Write an RGB picture as its suffix says; an existing file is replaced only once the new one is complete."""
    encoded, content = cv2.imencode(path.suffix, image[:, :, ::-1])
    if not encoded:
        raise RuntimeError(f"{path}: OpenCV could not encode the picture")
    with atomic_open(path, "wb") as file:
        file.write(content.tobytes())
