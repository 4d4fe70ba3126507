"""Labeled pictures as the tools that make them have them: shapes with the names that people gave them."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import final

import cv2
import numpy as np
from jaxtyping import Bool

from geoskill.errors import InputError
from geoskill.evaluation.regions import Polygon, size_text

MAX_PIXELS = 2**25
"""Largest area of a labeled picture, 8K."""
# A mask of more pieces is noise, whose outlines take long.
MAX_PIECES = 1000
# A circle of 200 px radius is off by a quarter of a pixel.
CIRCLE_VERTICES = 64


@final
@dataclass(frozen=True, eq=False)
class Shape:
    """One labeled shape.

    Attributes:
        label: as the person or the tool called it.
        outlines: a polygon ``[v, 2]`` in pixels for each of its pieces.
        holes: polygons inside of it that do not belong to it.
    """

    label: str
    outlines: Sequence[Polygon]
    holes: Sequence[Polygon] = ()


@final
@dataclass(frozen=True, eq=False)
class LabeledPicture:
    """The shapes of one picture.

    Attributes:
        origin: where it is described, for messages.
        name: of the picture's file.
        number: of the frame, where the tool knows it.
        size: width and height in pixels.
        shapes: in any order.
    """

    origin: str
    name: str
    number: int | None
    size: tuple[int, int]
    shapes: Sequence[Shape]

    def __post_init__(self) -> None:
        if not (min(self.size) > 0 and self.size[0] * self.size[1] <= MAX_PIXELS):
            raise InputError(
                f"{self.origin}: the picture is {size_text(self.size)}; expected at most {MAX_PIXELS} pixels"
            )


def rectangle(left: float, top: float, right: float, bottom: float, turned_deg: float = 0.0) -> Polygon:
    """Return a rectangle, turned about its center, clockwise as one sees it.

    >>> rectangle(0, 0, 4, 2, turned_deg=90).round(6).tolist()
    [[3.0, -1.0], [3.0, 3.0], [1.0, 3.0], [1.0, -1.0]]
    """
    corners = np.array([[left, top], [right, top], [right, bottom], [left, bottom]])
    center = corners.mean(axis=0)
    cosine, sine = math.cos(math.radians(turned_deg)), math.sin(math.radians(turned_deg))
    return np.asarray(center + (corners - center) @ [[cosine, sine], [-sine, cosine]], np.float32)


def ellipse(x: float, y: float, radius_x: float, radius_y: float) -> Polygon:
    """Return a polygon of :data:`CIRCLE_VERTICES` vertices on an ellipse whose axes are those of the picture."""
    angles = np.linspace(0, 2 * np.pi, CIRCLE_VERTICES, endpoint=False)
    return np.column_stack([x + radius_x * np.cos(angles), y + radius_y * np.sin(angles)]).astype(np.float32)


def shape_of_mask(
    origin: str, label: str, mask: Bool[np.ndarray, "height width"], corner: tuple[int, int] = (0, 0)
) -> Shape:
    """Return the outlines of a mask, which run through the centers of its outermost pixels.

    Args:
        origin: for messages.
        label: of the shape.
        mask: which pixels belong to it.
        corner: x and y of its first pixel.

    Raises:
        InputError: when it is in more than :data:`MAX_PIECES` pieces.
    """
    contours, hierarchy = cv2.findContours(mask.astype(np.uint8), cv2.RETR_CCOMP, cv2.CHAIN_APPROX_SIMPLE)
    if len(contours) > MAX_PIECES:
        raise InputError(
            f"{origin}: the mask {label!r} is in {len(contours)} pieces; expected a region of at most {MAX_PIECES}"
        )
    outlines: list[Polygon] = []
    holes: list[Polygon] = []
    parents = [] if hierarchy is None else np.reshape(hierarchy, (-1, 4))[:, 3]
    for contour, parent in zip(contours, parents, strict=True):
        polygon = np.reshape(contour, (-1, 2)).astype(np.float32) + np.asarray(corner, np.float32)
        (outlines if parent < 0 else holes).append(polygon)
    return Shape(label, outlines, holes)


def mask_of_runs(
    origin: str, runs: Sequence[int], height: int, width: int, *, by_column: bool
) -> Bool[np.ndarray, "height width"]:
    """Return the mask whose runs of pixels, outside and inside of it in turn, have these lengths.

    Args:
        origin: for messages.
        runs: their lengths, the first one outside.
        height: of the mask.
        width: of the mask.
        by_column: whether they go down the columns, as COCO's do, or along the rows, as CVAT's.

    Raises:
        InputError: when the runs do not fill the mask.

    >>> mask_of_runs("a", [1, 2, 1], 2, 2, by_column=True).tolist()
    [[False, True], [True, False]]
    """
    pixels = height * width
    if not 0 < pixels <= MAX_PIXELS or min(runs, default=-1) < 0 or sum(runs) != pixels:
        raise InputError(f"{origin}: the runs of the mask are not those of {width}x{height} pixels")
    inside = np.arange(len(runs)) % 2 == 1
    flat = np.repeat(inside, np.asarray(runs, np.int64))
    return flat.reshape((width, height)).T if by_column else flat.reshape((height, width))
