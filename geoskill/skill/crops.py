"""Crops of a frame around the nodes of an association, to show what a task definition speaks of."""

import math
from dataclasses import dataclass
from typing import Final, final

import numpy as np
from jaxtyping import UInt8

from geoskill.skill.association import Node

SIDE_RATIO: Final = 0.25
"""Side of a crop, as a share of the picture's shorter side: enough to see what thing it is."""
EXTENT_RATIO: Final = 1.4
"""Side of a crop, as a multiple of the extent of the line or outline in it."""


@final
@dataclass(frozen=True, eq=False)
class Crop:
    """A square part of a frame.

    Attributes:
        image: RGB.
        left: column of the frame that is its first one.
        top: row of the frame that is its first one.
    """

    image: UInt8[np.ndarray, "side side 3"]
    left: int
    top: int


def crop_around(image: UInt8[np.ndarray, "height width 3"], node: Node) -> Crop:
    """Return the part of a frame around a node; at the border it is shifted, so that it is full of picture.

    Args:
        image: RGB.
        node: a feature of it, in pixels.
    """
    height, width = image.shape[:2]
    extent = float(np.ptp(np.reshape(node.coordinates, (-1, 2)), axis=0).max())
    side = min(height, width, max(round(SIDE_RATIO * min(height, width)), math.ceil(EXTENT_RATIO * extent), 8))
    left, top = (
        int(np.clip(round(center - side / 2), 0, size - side))
        for center, size in zip(node.center, (width, height), strict=True)
    )
    return Crop(image[top : top + side, left : left + side].copy(), left, top)
