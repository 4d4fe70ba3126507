"""Panel beside the overlay's image: control error and confidences of each ensemble member."""

import math
import textwrap
from collections.abc import Sequence
from typing import NamedTuple, final

import cv2
import numpy as np
from jaxtyping import UInt8

from geoskill.skill.association import Association
from geoskill.viz.drawing import Color, Scale, draw_text, rank_color, text_size, truncated

PANEL_WIDTH = 272  # for a shorter side of 480 pixels
PAPER: Color = (255, 255, 255)

_INK: Color = (25, 25, 30)
_FAINT_INK: Color = (110, 110, 118)
_WARNING_INK: Color = (160, 80, 0)
_TRACK: Color = (232, 232, 236)
_SAMPLE_TEXT = "p2p sift: 1 feature"  # letters of average width
# Heights for a shorter side of 480 pixels: the heading of a block with its error, and one bar.
_HEADING_HEIGHT = 46
_BAR_HEIGHT = 19


@final
class Block(NamedTuple):
    """Content of one member's block.

    Attributes:
        heading: title of the block.
        associations: associations to show by rank, the top one first; empty where the member selected nothing.
    """

    heading: str
    associations: Sequence[Association]


def draw_panel(
    height: int, scale: Scale, blocks: Sequence[Block], frame_text: str, title: str, reasons: Sequence[str]
) -> UInt8[np.ndarray, "height width 3"]:
    """Return the panel, RGB: title and frame at the top, blocks below, reasons at the bottom.

    Args:
        height: height of the panel in pixels.
        scale: scale of the overlay.
        blocks: one for each member.
        frame_text: line below the title.
        title: one line, truncated where it is too long; empty for none.
        reasons: why members selected nothing, wrapped and cut off at a third of the panel.
    """
    panel = np.full((height, scale.px(PANEL_WIDTH), 3), PAPER, np.uint8)
    margin = scale.px(14)
    width = panel.shape[1] - 2 * margin
    y = margin + scale.px(9)
    if title:
        title_size = 0.56 * scale.unit
        draw_text(panel, truncated(title, width, title_size), (margin, y + scale.px(3)), title_size, _INK)
        y += scale.px(24)
    draw_text(panel, frame_text, (margin, y + scale.px(2)), 0.46 * scale.unit, _FAINT_INK)
    y += scale.px(14)
    columns = max(8, int(width / (text_size(_SAMPLE_TEXT, 0.4 * scale.unit)[0] / len(_SAMPLE_TEXT))))
    reason_lines = [line for reason in reasons for line in textwrap.wrap(reason, columns)]
    # At most a third of the panel, since the blocks above matter more.
    reason_lines = reason_lines[: len(panel) // 3 // scale.px(16)]
    bottom = len(panel) - margin - len(reason_lines) * scale.px(16)
    block_scale, heights = _block_heights(scale, [len(block.associations) for block in blocks], bottom - y)
    for block, block_height in zip(blocks, heights, strict=True):
        cv2.line(panel, (margin, y), (panel.shape[1] - margin, y), _TRACK, scale.px(1))
        _draw_block(panel[y : y + block_height, margin : margin + width], block_scale, block)
        y += block_height
    for i, line in enumerate(reason_lines):
        origin = (margin, bottom + i * scale.px(16) + scale.px(10))
        draw_text(panel, line, origin, 0.4 * scale.unit, _WARNING_INK)
    return panel


def _block_heights(scale: Scale, counts: Sequence[int], available: int) -> tuple[Scale, list[int]]:
    """Return the scale of the blocks and their heights in pixels.

    The heights are equal where that suffices, so that a block stays where it is while the number of bars in another one
    changes. Otherwise each block has the height that it needs, at a smaller scale where there is not enough room, down
    to a size that is still readable.

    Args:
        scale: scale of the overlay.
        counts: number of bars of each block.
        available: sum of the heights in pixels.
    """
    if not counts:
        return scale, []
    if scale.px(_HEADING_HEIGHT) + max(1, *counts) * scale.px(_BAR_HEIGHT) <= available // len(counts):
        return scale, [available // len(counts)] * len(counts)
    for shrinkage in (1.0, 0.95, 0.9, 0.85, 0.8, 0.75, 0.7):
        smaller = scale._replace(unit=shrinkage * scale.unit)
        needed = [smaller.px(_HEADING_HEIGHT) + max(1, count) * smaller.px(_BAR_HEIGHT) for count in counts]
        if sum(needed) <= available:
            break
    spare = (available - sum(needed)) // len(needed)
    return smaller, [need + spare for need in needed]


def _draw_block(canvas: UInt8[np.ndarray, "h w 3"], scale: Scale, block: Block) -> None:
    size, width = 0.43 * scale.unit, canvas.shape[1]
    norm, components = "", "no instance"
    if block.associations:
        top = block.associations[0]
        unit = f" {top.unit}".rstrip()
        norm = f"|E| = {_decimals(math.hypot(*top.error))}{unit}"
        components = f"E = ({', '.join(_decimals(component, '+') for component in top.error)}){unit}"
    norm_left = width - text_size(norm, size)[0]
    heading_size = 0.5 * scale.unit
    draw_text(
        canvas, truncated(block.heading, norm_left - scale.px(8), heading_size), (0, scale.px(20)), heading_size, _INK
    )
    draw_text(canvas, norm, (norm_left, scale.px(20)), size, _INK)
    draw_text(canvas, truncated(components, width, size), (0, scale.px(20) + scale.px(18)), size, _INK)
    _draw_bars(canvas[scale.px(_HEADING_HEIGHT) :], scale, block.associations)


def _draw_bars(canvas: UInt8[np.ndarray, "h w 3"], scale: Scale, associations: Sequence[Association]) -> None:
    """Draw the confidences as bars in the colors of the ranks, as many as fit."""
    size, width, row_height = 0.43 * scale.unit, canvas.shape[1], scale.px(_BAR_HEIGHT)
    capacity = max(1, len(canvas) // row_height)
    bars = associations if len(associations) <= capacity else associations[: max(1, capacity - 1)]
    left, right, half = scale.px(22), width - scale.px(50), scale.px(5)
    y = 0
    for association in bars:
        color, middle = rank_color(association.rank), y + row_height // 2
        draw_text(canvas, str(association.rank), (scale.px(2), middle + half), size, color)
        end = left + round((right - left) * float(np.clip(association.confidence, 0.0, 1.0)))
        cv2.rectangle(canvas, (left, middle - half), (right, middle + half), _TRACK, -1)
        cv2.rectangle(canvas, (left, middle - half), (end, middle + half), color, -1)
        percent = f"{100 * association.confidence:.1f}%"
        draw_text(canvas, percent, (width - text_size(percent, size)[0], middle + half), size, _INK)
        y += row_height
    if len(bars) < len(associations) and y + row_height <= len(canvas):
        remaining = f"and {len(associations) - len(bars)} more"
        draw_text(canvas, remaining, (left, y + row_height // 2 + half), size, _FAINT_INK)


def _decimals(value: float, sign: str = "-") -> str:
    return f"{value:{sign}.1f}" if abs(value) >= 10 else f"{value:{sign}.2f}"
