"""One frame with what a skill says about it, in the manner of the paper's Fig. 8.

On the picture: every feature, and the selected associations as colored lines, the top one of each kernel red. Beside
it: a panel with a block for each kernel: the control error of its top association and, in the colors of the lines, the
confidence of each association shown.
"""

import math
import textwrap
from collections.abc import Iterable, Sequence
from typing import NamedTuple, final

import cv2
import numpy as np
from jaxtyping import Float, UInt8

from geoskill.features.feature_set import FeatureSet
from geoskill.geometry.primitives import NodeType
from geoskill.skill.association import Association, Node

Color = tuple[int, int, int]

TOP_COLOR: Color = (230, 20, 30)
# Told apart on dark, on bright and by color-blind eyes as far as nine colors can be; ranks beyond start over.
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

_FEATURE: Color = (255, 235, 120)
_FEATURE_CASING: Color = (45, 45, 50)
_CASING: Color = (15, 15, 20)
_INK: Color = (25, 25, 30)
_FAINT_INK: Color = (110, 110, 118)
_WARNING_INK: Color = (160, 80, 0)
_PAPER: Color = (255, 255, 255)
_TRACK: Color = (232, 232, 236)
_SAMPLE = "p2p sift: 1 feature"  # letters of average width
_SUBPIXEL_BITS = 4
# Heights in the panel, for a shorter side of 480 pixels: a block's heading with its error, and a bar.
_HEAD = 46
_ROW = 19
_FONT = cv2.FONT_HERSHEY_SIMPLEX


def draw_overlay(
    image: UInt8[np.ndarray, "height width 3"],
    features: Sequence[FeatureSet],
    associations: Sequence[Association],
    *,
    frame_index: int,
    title: str = "",
    minimum_weight: float = 0.1,
    reasons: Sequence[str] = (),
) -> UInt8[np.ndarray, "out_height out_width 3"]:
    """The frame, with its features and associations drawn in, and the panel to its right; RGB.

    The picture is enlarged by the least integer that brings its shorter side to 480 pixels, so that pixel x of the
    frame becomes ``factor * (x + 0.5) - 0.5``. The result's size depends on the frame's size alone, so all frames of
    a video give one size. Of each kernel and descriptor the top association is drawn, and the others whose select-out
    exceeds ``minimum_weight`` (the paper's 10 %). With several kernels the lines carry the letter of their block
    and their rank. Lines that a node stands for are drawn thick and joined between their midpoints; more than two
    nodes are joined in a ring.

    Args:
        image: RGB; not modified.
        features: what every extractor found, in pixels of ``image``.
        associations: of all kernels, in any order. One without nodes (rank 0) shows that its kernel has no instance.
        frame_index: the number to print.
        title: one line; cut where it is too long.
        minimum_weight: in [0, 1].
        reasons: why kernels have no instance, one sentence each.
    """
    scale = _Scale.of(image)
    members = _members(associations)
    picture = cv2.resize(image, None, fx=scale.factor, fy=scale.factor, interpolation=cv2.INTER_CUBIC)
    canvas = np.ascontiguousarray(picture, np.uint8)
    for feature_set in features:
        for geometry in feature_set.geometry:
            _draw_feature(canvas, scale, feature_set.node_type, geometry.reshape(-1, 2))
    shown = [(letter, one) for letter, member in members for one in _shown(member, minimum_weight)]
    # The best ones last, so that nothing covers them.
    shown.sort(key=lambda pair: -pair[1].rank)
    for _, association in shown:
        _draw_association(canvas, scale, association)
    if len(members) > 1:
        for letter, association in shown:
            _draw_tag(canvas, scale, association, f"{letter}{association.rank}")
    panel = np.full((len(canvas), scale.px(272), 3), _PAPER, np.uint8)
    _draw_panel(panel, scale, members, minimum_weight, f"frame {frame_index}", title, reasons)
    return np.concatenate([canvas, panel], axis=1)


def rank_color(rank: int) -> Color:
    """The color of an association of this rank, RGB; 1 is red and no other is."""
    return TOP_COLOR if rank <= 1 else OTHER_COLORS[(rank - 2) % len(OTHER_COLORS)]


@final
class _Scale(NamedTuple):
    """``factor`` enlarges the picture, ``unit`` the pen and the print, drawn for a shorter side of 480 pixels."""

    factor: int
    unit: float

    @classmethod
    def of(cls, image: np.ndarray) -> "_Scale":
        shorter = min(image.shape[:2])
        factor = max(1, math.ceil(MINIMUM_SHORTER_SIDE_PX / shorter))
        return cls(factor, factor * shorter / MINIMUM_SHORTER_SIDE_PX)

    def px(self, length: int) -> int:
        return max(1, round(length * self.unit))

    def enlarged(self, xy: Float[np.ndarray, "p 2"]) -> Float[np.ndarray, "p 2"]:
        return np.asarray(self.factor * (np.asarray(xy, np.float64) + 0.5) - 0.5)


def _members(associations: Iterable[Association]) -> list[tuple[str, list[Association]]]:
    """The associations of each (kernel, descriptor) by rank, under a letter, in the order of first appearance."""
    grouped: dict[tuple[str, str], list[Association]] = {}
    for association in associations:
        grouped.setdefault((association.kernel, association.descriptor), []).append(association)
    return [(chr(ord("A") + i), sorted(group, key=lambda a: a.rank)) for i, group in enumerate(grouped.values())]


def _shown(member: Sequence[Association], minimum_weight: float) -> list[Association]:
    with_nodes = [association for association in member if association.nodes]
    return with_nodes[:1] + [a for a in with_nodes[1:] if a.weight > minimum_weight]


# ---------------------------------------------------------------------------------------------------------- picture


def _polyline(
    canvas: UInt8[np.ndarray, "h w 3"],
    xy: Float[np.ndarray, "p 2"],
    color: Color,
    thickness: int,
    closed: bool = False,
) -> None:
    fixed_point = np.round(xy * 2**_SUBPIXEL_BITS).astype(np.int32)
    cv2.polylines(canvas, [fixed_point], closed, color, thickness, cv2.LINE_AA, _SUBPIXEL_BITS)


def _disc(
    canvas: UInt8[np.ndarray, "h w 3"], xy: Float[np.ndarray, " 2"], radius: float, color: Color, thickness: int = -1
) -> None:
    one = 2**_SUBPIXEL_BITS
    center = (round(float(xy[0]) * one), round(float(xy[1]) * one))
    cv2.circle(canvas, center, round(radius * one), color, thickness, cv2.LINE_AA, _SUBPIXEL_BITS)


def _draw_feature(
    canvas: UInt8[np.ndarray, "h w 3"], scale: _Scale, node_type: NodeType, xy: Float[np.ndarray, "p 2"]
) -> None:
    # The dark casing keeps a pale mark legible on a pale ground.
    for color, width in ((_FEATURE_CASING, 2 * scale.px(1)), (_FEATURE, scale.px(1))):
        if node_type is NodeType.POINT:
            _disc(canvas, scale.enlarged(xy)[0], 2.6 * scale.unit, color, width)
        else:
            _polyline(canvas, scale.enlarged(xy), color, width)


def _draw_association(canvas: UInt8[np.ndarray, "h w 3"], scale: _Scale, association: Association) -> None:
    color = rank_color(association.rank)
    width = scale.px(3 if association.rank == 1 else 2)
    casing = width + 2 * scale.px(1)
    centers = scale.enlarged(np.array([node.center for node in association.nodes]))
    if len(centers) > 2:
        # Around their centroid, so that the ring does not cross itself.
        offset = centers - centers.mean(axis=0)
        centers = centers[np.argsort(np.arctan2(offset[:, 1], offset[:, 0]), kind="stable")]
    closed = len(centers) > 2
    for pen, link_width, node_width in ((_CASING, casing, casing + scale.px(1)), (color, width, width + scale.px(1))):
        _polyline(canvas, centers, pen, link_width, closed)
        for node in association.nodes:
            _draw_node(canvas, scale, node, pen, node_width)


def _draw_node(canvas: UInt8[np.ndarray, "h w 3"], scale: _Scale, node: Node, pen: Color, width: int) -> None:
    xy = scale.enlarged(np.reshape(np.asarray(node.coordinates, np.float64), (-1, 2)))
    if node.node_type is NodeType.POINT:
        _disc(canvas, xy[0], width / 2 + 2.5 * scale.unit, pen)
    else:
        _polyline(canvas, xy, pen, width)
        _disc(canvas, xy.mean(axis=0), width / 2 + 0.5 * scale.unit, pen)


def _draw_tag(canvas: UInt8[np.ndarray, "h w 3"], scale: _Scale, association: Association, tag: str) -> None:
    size = 0.4 * scale.unit
    width, height = _print_size(tag, size)
    center = scale.enlarged(np.array([node.center for node in association.nodes])).mean(axis=0)
    pad = scale.px(3)
    left = int(np.clip(round(center[0] - width / 2), pad, max(pad, canvas.shape[1] - width - pad)))
    top = int(np.clip(round(center[1] - height / 2), pad, max(pad, canvas.shape[0] - height - pad)))
    corners = (left - pad, top - pad), (left + width + pad, top + height + pad)
    cv2.rectangle(canvas, *corners, rank_color(association.rank), -1)
    cv2.rectangle(canvas, *corners, _CASING, scale.px(1))
    _print(canvas, tag, (left, top + height), size, _PAPER)


# ------------------------------------------------------------------------------------------------------------ panel


def _draw_panel(
    panel: UInt8[np.ndarray, "h w 3"],
    scale: _Scale,
    members: Sequence[tuple[str, Sequence[Association]]],
    minimum_weight: float,
    frame_text: str,
    title: str,
    reasons: Sequence[str],
) -> None:
    margin = scale.px(14)
    width = panel.shape[1] - 2 * margin
    y = margin + scale.px(9)
    if title:
        _print(panel, _cut(title, width, 0.56 * scale.unit), (margin, y + scale.px(3)), 0.56 * scale.unit, _INK)
        y += scale.px(24)
    _print(panel, frame_text, (margin, y + scale.px(2)), 0.46 * scale.unit, _FAINT_INK)
    y += scale.px(14)
    columns = max(8, int(width / (_print_size(_SAMPLE, 0.4 * scale.unit)[0] / len(_SAMPLE))))
    reason_lines = [line for reason in reasons for line in textwrap.wrap(reason, columns)]
    # At most a third of the panel: the blocks above matter more.
    reason_lines = reason_lines[: len(panel) // 3 // scale.px(16)]
    bottom = len(panel) - margin - len(reason_lines) * scale.px(16)
    bars = [_shown(member, minimum_weight) for _, member in members]
    block_scale, heights = _block_heights(scale, [len(shown) for shown in bars], bottom - y)
    for (letter, member), shown, height in zip(members, bars, heights, strict=True):
        cv2.line(panel, (margin, y), (panel.shape[1] - margin, y), _TRACK, scale.px(1))
        heading = f"{member[0].kernel} {member[0].descriptor}"
        block = panel[y : y + height, margin : margin + width]
        _draw_block(block, block_scale, f"{letter}  {heading}" if len(members) > 1 else heading, shown)
        y += height
    for i, line in enumerate(reason_lines):
        _print(panel, line, (margin, bottom + i * scale.px(16) + scale.px(10)), 0.4 * scale.unit, _WARNING_INK)


def _block_heights(scale: _Scale, counts: Sequence[int], available: int) -> tuple[_Scale, list[int]]:
    """The scale of the print in the blocks and the height of each, for ``counts`` bars in it.

    Equal heights where they suffice, so that a block stays where it is while the number of bars in another changes;
    else as each needs, in smaller print where there is no room, down to a size that can still be read.
    """
    if not counts:
        return scale, []
    if scale.px(_HEAD) + max(1, *counts) * scale.px(_ROW) <= available // len(counts):
        return scale, [available // len(counts)] * len(counts)
    for shrinkage in (1.0, 0.95, 0.9, 0.85, 0.8, 0.75, 0.7):
        smaller = scale._replace(unit=shrinkage * scale.unit)
        needed = [smaller.px(_HEAD) + max(1, count) * smaller.px(_ROW) for count in counts]
        if sum(needed) <= available:
            break
    spare = (available - sum(needed)) // len(needed)
    return smaller, [need + spare for need in needed]


def _draw_block(block: UInt8[np.ndarray, "h w 3"], scale: _Scale, heading: str, shown: Sequence[Association]) -> None:
    size, row, width = 0.43 * scale.unit, scale.px(_ROW), block.shape[1]
    error, unit = (shown[0].error, f" {shown[0].unit}".rstrip()) if shown else ((), "")
    norm = f"|E| = {_decimals(math.hypot(*error))}{unit}" if shown else ""
    norm_left = width - _print_size(norm, size)[0]
    y = scale.px(20)
    _print(block, _cut(heading, norm_left - scale.px(8), 0.5 * scale.unit), (0, y), 0.5 * scale.unit, _INK)
    _print(block, norm, (norm_left, y), size, _INK)
    y += scale.px(18)
    components = f"E = ({', '.join(_decimals(value, '+') for value in error)}){unit}" if shown else "no instance"
    _print(block, _cut(components, width, size), (0, y), size, _INK)
    y = scale.px(_HEAD)
    capacity = max(1, (len(block) - y) // row)
    bars = shown if len(shown) <= capacity else shown[: max(1, capacity - 1)]
    left, right = scale.px(22), width - scale.px(50)
    for association in bars:
        color, middle, half = rank_color(association.rank), y + row // 2, scale.px(5)
        _print(block, str(association.rank), (scale.px(2), middle + half), size, color)
        end = left + round((right - left) * float(np.clip(association.confidence, 0.0, 1.0)))
        cv2.rectangle(block, (left, middle - half), (right, middle + half), _TRACK, -1)
        cv2.rectangle(block, (left, middle - half), (end, middle + half), color, -1)
        percent = f"{100 * association.confidence:.1f}%"
        _print(block, percent, (width - _print_size(percent, size)[0], middle + half), size, _INK)
        y += row
    if len(bars) < len(shown) and y + row <= len(block):
        _print(block, f"and {len(shown) - len(bars)} more", (left, y + row // 2 + scale.px(5)), size, _FAINT_INK)


def _decimals(value: float, sign: str = "-") -> str:
    return f"{value:{sign}.1f}" if abs(value) >= 10 else f"{value:{sign}.2f}"


def _print_size(text: str, size: float) -> tuple[int, int]:
    (width, height), _ = cv2.getTextSize(text, _FONT, size, 1)
    return int(width), int(height)


def _cut(text: str, width: int, size: float) -> str:
    if _print_size(text, size)[0] <= width:
        return text
    while text and _print_size(text + "...", size)[0] > width:
        text = text[:-1]
    return text + "..."


def _print(canvas: UInt8[np.ndarray, "h w 3"], text: str, origin: tuple[int, int], size: float, color: Color) -> None:
    """Prints from the left end of the baseline; OpenCV's print is anti-aliased and knows ASCII in all its versions."""
    ascii_text = text.encode("ascii", "replace").decode()
    cv2.putText(canvas, ascii_text, origin, _FONT, size, color, max(1, round(size)), cv2.LINE_AA)
