"""Panel beside the overlay's picture: state, control error and confidences of each member.

It takes at most a quarter of the width.
"""

import math
import textwrap
from collections.abc import Sequence
from typing import NamedTuple, final

import cv2
import numpy as np
from jaxtyping import UInt8

from geoskill.skill.association import Association
from geoskill.skill.member_status import State
from geoskill.viz.drawing import FAINT_INK, INK, PAPER, Color, Scale, draw_text, rank_color, text_size, truncated
from geoskill.viz.strip import STATE_COLORS

_WARNING_INK: Color = (160, 80, 0)
_TRACK: Color = (232, 232, 236)
_SAMPLE_TEXT = "p2p sift: 1 feature"  # letters of average width
# Heights for an overlay that is 640 pixels wide: the lines of a block, and one bar.
_LINE_HEIGHT = 17
_BAR_HEIGHT = 16
_SIZE = 0.42


@final
class Block(NamedTuple):
    """Content of one member's block.

    Attributes:
        heading: title of the block.
        associations: associations to show by rank, the top one first; empty where the member selected nothing.
        state: of the member; None where it is not known.
        color: of the member's curve; None without one.
    """

    heading: str
    associations: Sequence[Association]
    state: State | None = None
    color: Color | None = None


def draw_panel(
    height: int, width: int, scale: Scale, blocks: Sequence[Block], place: str, title: str, reasons: Sequence[str]
) -> UInt8[np.ndarray, "height width 3"]:
    """Return the panel, RGB: title, frame and time at the top, blocks below, reasons at the bottom.

    Args:
        height: height of the panel in pixels.
        width: its width in pixels.
        scale: scale of the overlay.
        blocks: one for each member.
        place: line below the title: which frame it is, and its time.
        title: one line, truncated where it is too long; empty for none.
        reasons: why members selected nothing, wrapped and cut off at a third of the panel.
    """
    panel = np.full((height, width, 3), PAPER, np.uint8)
    margin, size = scale.text_px(8), _SIZE * scale.text
    inner = width - 2 * margin
    y = scale.text_px(4)
    if title:
        y += scale.text_px(_LINE_HEIGHT)
        draw_text(panel, truncated(title, inner, size), (margin, y), size, INK)
    y += scale.text_px(_LINE_HEIGHT)
    draw_text(panel, truncated(place, inner, size), (margin, y), size, FAINT_INK)
    y += scale.text_px(8)
    columns = max(8, int(inner / (text_size(_SAMPLE_TEXT, 0.4 * scale.text)[0] / len(_SAMPLE_TEXT))))
    reason_lines = [line for reason in reasons for line in textwrap.wrap(reason, columns)]
    # At most a third of the panel, since the blocks above matter more.
    reason_lines = reason_lines[: len(panel) // 3 // scale.text_px(15)]
    bottom = len(panel) - margin - len(reason_lines) * scale.text_px(15)
    block_scale, heights = _block_heights(scale, blocks, bottom - y)
    for block, block_height in zip(blocks, heights, strict=True):
        cv2.line(panel, (margin, y), (width - margin, y), _TRACK, scale.text_px(1))
        _draw_block(panel[y : y + block_height, margin : margin + inner], block_scale, block)
        y += block_height
    for i, line in enumerate(reason_lines):
        origin = (margin, bottom + i * scale.text_px(15) + scale.text_px(10))
        draw_text(panel, line, origin, 0.4 * scale.text, _WARNING_INK)
    return panel


def _lines_of(block: Block) -> list[tuple[str, Color]]:
    """Return the lines of a block below its heading, with their colors."""
    lines: list[tuple[str, Color]] = []
    if block.state is not None:
        lines.append((str(block.state), STATE_COLORS[block.state]))
    if not block.associations:
        return [*lines, ("no instance", INK)]
    top = block.associations[0]
    shown, factor = ("mm", 1e3) if top.unit == "m" else (top.unit, 1.0)
    unit, error = f" {shown}".rstrip(), [factor * component for component in top.error]
    lines.append((f"|E| {_decimals(math.hypot(*error))}{unit}", INK))
    if len(error) > 1:
        lines.append((f"E {' '.join(_decimals(component, '+') for component in error)}", INK))
    if top.goal is not None:
        lines.append((f"to go {_decimals(factor * math.hypot(*top.goal.error))}{unit}", INK))
    return lines


def _needed(block: Block) -> int:
    """Return the height that a block needs, for an overlay that is 640 pixels wide."""
    return (1 + len(_lines_of(block))) * _LINE_HEIGHT + 6 + max(1, len(block.associations)) * _BAR_HEIGHT


def _block_heights(scale: Scale, blocks: Sequence[Block], available: int) -> tuple[Scale, list[int]]:
    """Return the scale of the blocks and their heights in pixels.

    The heights are equal where that suffices, so that a block stays where it is while the number of bars in another one
    changes. Otherwise each block has the height that it needs, at a smaller scale where there is not enough room, down
    to a size that is still readable.

    Args:
        scale: scale of the overlay.
        blocks: the blocks.
        available: sum of the heights in pixels.
    """
    if not blocks:
        return scale, []
    needs = [_needed(block) for block in blocks]
    if scale.text_px(max(needs)) <= available // len(blocks):
        return scale, [available // len(blocks)] * len(blocks)
    for shrinkage in (1.0, 0.95, 0.9, 0.85, 0.8):
        smaller = scale._replace(text=shrinkage * scale.text)
        needed = [smaller.text_px(need) for need in needs]
        if sum(needed) <= available:
            break
    spare = (available - sum(needed)) // len(needed)
    return smaller, [max(0, need + spare) for need in needed]


def _draw_block(canvas: UInt8[np.ndarray, "h w 3"], scale: Scale, block: Block) -> None:
    size, width = _SIZE * scale.text, canvas.shape[1]
    y, left = scale.text_px(_LINE_HEIGHT), 0
    if block.color is not None:
        left = scale.text_px(14)
        cv2.rectangle(canvas, (0, y - scale.text_px(7)), (scale.text_px(9), y - scale.text_px(2)), block.color, -1)
    draw_text(canvas, truncated(block.heading, width - left, size), (left, y), size, INK)
    for line, color in _lines_of(block):
        y += scale.text_px(_LINE_HEIGHT)
        draw_text(canvas, truncated(line, width, size), (0, y), size, color)
    _draw_bars(canvas[y + scale.text_px(6) :], scale, block.associations)


def _draw_bars(canvas: UInt8[np.ndarray, "h w 3"], scale: Scale, associations: Sequence[Association]) -> None:
    """Draw the confidences as bars in the colors of the ranks, as many as fit."""
    size, width, row_height = 0.4 * scale.text, canvas.shape[1], scale.text_px(_BAR_HEIGHT)
    capacity = max(1, len(canvas) // row_height)
    bars = associations if len(associations) <= capacity else associations[: max(1, capacity - 1)]
    left, right, half = scale.text_px(16), width - scale.text_px(38), scale.text_px(4)
    y = 0
    for association in bars:
        color, middle = rank_color(association.rank), y + row_height // 2
        draw_text(canvas, str(association.rank), (0, middle + half), size, color)
        end = left + round((right - left) * float(np.clip(association.confidence, 0.0, 1.0)))
        cv2.rectangle(canvas, (left, middle - half), (right, middle + half), _TRACK, -1)
        cv2.rectangle(canvas, (left, middle - half), (end, middle + half), color, -1)
        percent = f"{100 * association.confidence:.0f}%"
        draw_text(canvas, percent, (width - text_size(percent, size)[0], middle + half), size, INK)
        y += row_height
    if len(bars) < len(associations) and y + row_height <= len(canvas):
        remaining = f"and {len(associations) - len(bars)} more"
        draw_text(canvas, remaining, (left, y + row_height // 2 + half), size, FAINT_INK)


def _decimals(value: float, sign: str = "-") -> str:
    return f"{value:{sign}.1f}" if abs(value) >= 10 else f"{value:{sign}.2f}"
