"""Colors, scale and drawing primitives of the overlay."""

import math
from typing import NamedTuple, final

import cv2
import numpy as np
from jaxtyping import Float, UInt8

Color = tuple[int, int, int]

TOP_COLOR: Color = (230, 20, 30)
# As distinct as nine colors can be on dark and on bright images, also for color-blind people; higher ranks start over.
OTHER_COLORS: tuple[Color, ...] = (
    (0, 130, 245),
    (245, 150, 0),
    (0, 165, 95),
    (170, 70, 215),
    (0, 185, 200),
    (240, 105, 175),
    (150, 100, 45),
    (130, 165, 0),
    (115, 115, 235),
)
MINIMUM_SHORTER_SIDE_PX = 480
PAPER: Color = (255, 255, 255)
INK: Color = (25, 25, 30)
FAINT_INK: Color = (110, 110, 118)
CASING: Color = (15, 15, 20)
"""Around what is drawn on the picture, so that it is seen on a bright one, too."""
READABLE_WIDTH_PX = 640
MAX_TEXT_RATIO = 2.5

_SUBPIXEL_BITS = 4
_FONT = cv2.FONT_HERSHEY_SIMPLEX


def rank_color(rank: int) -> Color:
    """Return the RGB color of an association of this rank; rank 1 is red and no other is."""
    return TOP_COLOR if rank <= 1 else OTHER_COLORS[(rank - 2) % len(OTHER_COLORS)]


@final
class Scale(NamedTuple):
    """Scale of an overlay.

    Attributes:
        factor: integer by which the picture is enlarged.
        unit: factor of the sizes of marks on the picture, which are given for a shorter side of 480 pixels.
        text: factor of the sizes of text and of what is beside and below the picture. They are given for an overlay
            that is 640 pixels wide, so that they are still read when it is shown at that width.
    """

    factor: int
    unit: float
    text: float

    @classmethod
    def of(cls, image: UInt8[np.ndarray, "height width 3"]) -> "Scale":
        """Return the smallest scale that makes the shorter side at least 480 pixels long."""
        shorter_side = min(image.shape[:2])
        factor = max(1, math.ceil(MINIMUM_SHORTER_SIDE_PX / shorter_side))
        unit = factor * shorter_side / MINIMUM_SHORTER_SIDE_PX
        width = factor * image.shape[1]
        # A panorama would leave no room for the picture.
        return cls(factor, unit, min((width + panel_width(width)) / READABLE_WIDTH_PX, MAX_TEXT_RATIO * unit))

    def px(self, length: int) -> int:
        """Return a length on the picture in pixels of the overlay, at least 1."""
        return max(1, round(length * self.unit))

    def text_px(self, length: float) -> int:
        """Return a length beside or below the picture in pixels of the overlay, at least 1."""
        return max(1, round(length * self.text))

    def enlarged(self, xy: Float[np.ndarray, "p 2"]) -> Float[np.ndarray, "p 2"]:
        """Return pixels of the image as pixels of the overlay."""
        return np.asarray(self.factor * (np.asarray(xy, np.float64) + 0.5) - 0.5)


def panel_width(picture_width: int) -> int:
    """Return the width of the text beside a picture, at most a quarter of both; in pixels."""
    return picture_width // 3


def draw_polyline(
    canvas: UInt8[np.ndarray, "h w 3"],
    xy: Float[np.ndarray, "p 2"],
    color: Color,
    thickness: int,
    closed: bool = False,
) -> None:
    """Draw anti-aliased segments between consecutive points, with subpixel precision."""
    fixed_point = np.round(xy * 2**_SUBPIXEL_BITS).astype(np.int32)
    cv2.polylines(canvas, [fixed_point], closed, color, thickness, cv2.LINE_AA, _SUBPIXEL_BITS)


def draw_disc(
    canvas: UInt8[np.ndarray, "h w 3"], xy: Float[np.ndarray, " 2"], radius: float, color: Color, thickness: int = -1
) -> None:
    """Draw an anti-aliased disc, or a circle of a positive thickness, with subpixel precision."""
    subpixels = 2**_SUBPIXEL_BITS
    center = (round(float(xy[0]) * subpixels), round(float(xy[1]) * subpixels))
    cv2.circle(canvas, center, round(radius * subpixels), color, thickness, cv2.LINE_AA, _SUBPIXEL_BITS)


def draw_dashes(
    canvas: UInt8[np.ndarray, "h w 3"],
    xy: Float[np.ndarray, "p 2"],
    color: Color,
    thickness: int,
    dash: float,
    closed: bool = False,
) -> None:
    """Draw segments between consecutive points as dashes of a length in pixels, with gaps of the same length.

    A segment begins and ends with a dash.
    """
    ends = np.roll(xy, -1, axis=0) if closed else xy[1:]
    for start, end in zip(xy, ends, strict=False):
        pieces = 2 * round(float(np.linalg.norm(end - start)) / dash / 2) + 1
        for piece in range(0, pieces, 2):
            share = np.array([[piece], [piece + 1]]) / pieces
            draw_polyline(canvas, start + share * (end - start), color, thickness)


def text_size(text: str, size: float) -> tuple[int, int]:
    """Return width and height of a text in pixels."""
    (width, height), _ = cv2.getTextSize(text, _FONT, size, 1)
    return int(width), int(height)


def truncated(text: str, width: int, size: float) -> str:
    """Return the text, cut short with an ellipsis where it is wider than ``width`` pixels."""
    if text_size(text, size)[0] <= width:
        return text
    while text and text_size(text + "...", size)[0] > width:
        text = text[:-1]
    return text + "..."


def draw_text(
    canvas: UInt8[np.ndarray, "h w 3"], text: str, origin: tuple[int, int], size: float, color: Color
) -> None:
    """Draw text from the left end of its baseline; characters outside ASCII become question marks."""
    # OpenCV's own font is anti-aliased and knows ASCII in all its versions.
    ascii_text = text.encode("ascii", "replace").decode()
    cv2.putText(canvas, ascii_text, origin, _FONT, size, color, max(1, round(size)), cv2.LINE_AA)
