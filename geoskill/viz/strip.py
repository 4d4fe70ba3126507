"""Strip below the overlay's picture: the legend of its marks, and the errors of all members over the frames so far."""

import math
from collections.abc import Iterator
from typing import final

import numpy as np
from jaxtyping import Float64, UInt8

from geoskill.geometry.primitives import NodeType
from geoskill.skill.association import InferenceResult, Node, NodeRole
from geoskill.skill.member_status import State
from geoskill.viz.curves import COLORS
from geoskill.viz.drawing import (
    CASING,
    FAINT_INK,
    INK,
    PAPER,
    TOP_COLOR,
    Color,
    Scale,
    draw_dashes,
    draw_polyline,
    draw_text,
    text_size,
)
from geoskill.viz.marks import DASH_PX, draw_cross, draw_node

STRIP_HEIGHT = 100
"""For an overlay that is 640 pixels wide."""
MAX_FRAMES = 300
"""Frames that are shown of a source that may be endless: its last ones."""
STATE_COLORS: dict[State, Color] = {
    State.APPROACHING: (70, 110, 170),
    State.AT_GOAL: (0, 135, 90),
    State.UNSURE: (225, 130, 0),
    State.LOST: (130, 130, 138),
}
_GRID: Color = (222, 222, 228)
_LEGEND_HEIGHT = 20
_BAND_HEIGHT = 4


def member_color(number: int) -> Color:
    """Return the RGB color of a member's curve, by its place among the members."""
    code = COLORS[number % len(COLORS)]
    return int(code[1:3], 16), int(code[3:5], 16), int(code[5:7], 16)


@final
class ErrorHistory:
    """Error norms and states of all members over the frames of a video.

    Args:
        total: number of frames, where it is known; the curves then end at the right border in the last one.
    """

    def __init__(self, total: int | None = None) -> None:
        self._length = MAX_FRAMES if total is None else max(1, total)
        self._count = 0
        self._norms: dict[str, Float64[np.ndarray, " n"]] = {}
        self._states: dict[str, list[State]] = {}
        self._units: dict[str, str] = {}

    def add(self, result: InferenceResult) -> None:
        """Take in the next frame."""
        tops = {association.member: association for association in result.associations if association.rank == 1}
        self._units = {name: status.unit for name, status in result.members.items()}
        for name, status in result.members.items():
            norms = self._norms.setdefault(name, np.full(self._length, np.nan))
            states = self._states.setdefault(name, [State.LOST] * self._length)
            if self._count >= self._length:
                norms[:-1] = norms[1:]
                states.pop(0)
                states.append(State.LOST)
            place = min(self._count, self._length - 1)
            norms[place] = math.hypot(*tops[name].error) if name in tops else np.nan
            states[place] = status.state
        self._count += 1

    @property
    def place(self) -> float | None:
        """Place of the present frame along the curves, in [0, 1]; None before the first frame."""
        if self._count == 0:
            return None
        return (min(self._count, self._length) - 1) / max(1, self._length - 1)

    def scales(self) -> dict[str, float]:
        """Return for each unit a round number that no error so far exceeds."""
        largest: dict[str, float] = {}
        for name, norms in self._norms.items():
            unit = self._units.get(name, "px")
            largest[unit] = max(largest.get(unit, 0.0), float(np.nanmax(norms, initial=0.0)))
        return {unit: _round_up(value) for unit, value in largest.items()}

    def curves(self) -> Iterator[tuple[Float64[np.ndarray, " n"], list[State]]]:
        """Yield error norms as shares of the scale of their unit, NaN where there is none, and states, by member."""
        scales = self.scales()
        for name, norms in self._norms.items():
            yield norms / scales[self._units.get(name, "px")], self._states[name]


def draw_strip(width: int, scale: Scale, history: ErrorHistory | None) -> UInt8[np.ndarray, "height width 3"]:
    """Return the strip, RGB.

    A curve is the norm of the control error of a member's top association, in the member's color. The bars below the
    curves have the colors of the members' states.

    Args:
        width: in pixels.
        scale: of the overlay.
        history: of the frames up to the one shown; None for the legend alone.
    """
    canvas = np.full((scale.text_px(STRIP_HEIGHT), width, 3), PAPER, np.uint8)
    _draw_legend(canvas, scale)
    if history is not None and history.place is not None:
        _draw_curves(canvas, scale, history)
    return canvas


def _draw_legend(canvas: UInt8[np.ndarray, "h w 3"], scale: Scale) -> None:
    size, middle = 0.4 * scale.text, scale.text_px(_LEGEND_HEIGHT) // 2 + scale.text_px(1)
    marks = Scale(1, scale.text, scale.text)  # a legend as large as the text
    x = scale.text_px(8)
    for name in ("moved", "rests", "pair", "goal"):
        half = scale.text_px(12) if name == "pair" else scale.text_px(6)
        center = np.array([x + half, middle], np.float64)
        if name == "pair":
            reach = np.array([half, 0.0])
            ends = np.stack([center - reach, center + reach])
            draw_dashes(canvas, ends, CASING, 4 * marks.px(1), marks.px(DASH_PX))
            draw_dashes(canvas, ends, TOP_COLOR, 2 * marks.px(1), marks.px(DASH_PX))
        elif name == "goal":
            draw_cross(canvas, marks, center, TOP_COLOR)
        else:
            role = NodeRole.MOVING if name == "moved" else NodeRole.RESTING
            xy = (float(center[0]), float(center[1]))
            draw_node(canvas, marks, Node(NodeType.POINT, xy, role=role), TOP_COLOR, marks.px(3))
        x += 2 * half + scale.text_px(6)
        draw_text(canvas, name, (x, middle + scale.text_px(4)), size, INK)
        x += text_size(name, size)[0] + scale.text_px(14)


def _draw_curves(canvas: UInt8[np.ndarray, "h w 3"], scale: Scale, history: ErrorHistory) -> None:
    size, curves = 0.38 * scale.text, list(history.curves())
    label = "error, up to " + ", ".join(f"{value:g} {unit}".rstrip() for unit, value in history.scales().items())
    left, right = scale.text_px(8), canvas.shape[1] - scale.text_px(8)
    band = scale.text_px(_BAND_HEIGHT)
    top, bottom = scale.text_px(_LEGEND_HEIGHT + 2), len(canvas) - scale.text_px(4) - len(curves) * (band + 1)
    for y in (top, bottom):
        _draw_line(canvas, (left, y), (right, y), _GRID, scale)
    place = history.place or 0.0
    now = round(left + (right - left) * place)
    _draw_line(canvas, (now, top), (now, len(canvas) - scale.text_px(2)), INK, scale)
    for number, (norms, states) in enumerate(curves):
        x = left + (right - left) * np.arange(len(norms)) / max(1, len(norms) - 1)
        known = np.isfinite(norms)
        y = bottom - (bottom - top) * np.nan_to_num(norms)
        for run in np.split(np.arange(len(norms)), np.flatnonzero(np.diff(known)) + 1):
            if known[run[0]]:
                curve = np.stack([x[run], y[run]], axis=1)
                # OpenCV draws nothing of a single point.
                curve = np.repeat(curve, 2, axis=0) if len(curve) == 1 else curve
                draw_polyline(canvas, curve, member_color(number), 2 * scale.text_px(0.75))
        _draw_band(canvas, scale, bottom + 2 + number * (band + 1), x, states, history)
    # On the side where the curves are not yet, or have long been.
    text_left = left if place > 0.5 else right - text_size(label, size)[0]
    draw_text(canvas, label, (text_left, top + scale.text_px(12)), size, FAINT_INK)


def _draw_band(
    canvas: UInt8[np.ndarray, "h w 3"],
    scale: Scale,
    top: int,
    x: Float64[np.ndarray, " n"],
    states: list[State],
    history: ErrorHistory,
) -> None:
    """Draw the states of a member as bars, up to the present frame."""
    last = round((history.place or 0.0) * (len(x) - 1))
    for frame in range(last + 1):
        start, end = round(float(x[max(0, frame - 1)])), round(float(x[frame])) + 1
        canvas[top : top + scale.text_px(_BAND_HEIGHT), start:end] = STATE_COLORS[states[frame]]


def _draw_line(
    canvas: UInt8[np.ndarray, "h w 3"], start: tuple[int, int], end: tuple[int, int], color: Color, scale: Scale
) -> None:
    """Draw a thin straight line."""
    draw_polyline(canvas, np.array([start, end], np.float64), color, scale.text_px(1))


def _round_up(value: float) -> float:
    """Return the next of 1, 2, 5, 10, 20, … and their parts."""
    if not value > 0:
        return 1.0
    power = 10.0 ** math.floor(math.log10(value))
    return next(factor * power for factor in (1.0, 2.0, 5.0, 10.0) if value <= factor * power * (1 + 1e-9))
