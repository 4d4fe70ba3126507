"""Plots of the page: curves over time with a cursor, curves of the training, and reliability."""

from collections.abc import Mapping, Sequence

import numpy as np
from bokeh.events import Tap
from bokeh.models import ColumnDataSource, CustomJS, Range1d, Span
from bokeh.plotting import figure
from jaxtyping import Float64

from geoskill.skill.member_status import State
from geoskill.viz.curves import COLORS, Curve
from geoskill.viz.report.curves import MemberCurves, runs_of
from geoskill.viz.strip import STATE_COLORS

CURSOR = "cursor"
"""Prefix of the names of the cursors, by which the page's script finds them."""
TOOLS = "xpan,xbox_zoom,reset,save"
NORM_COLOR = "#111111"
GOAL_COLOR = "#0b7a4b"
GATE_COLOR = "#d55e00"
SMOOTHING = 25
"""Training curves are averages over this part of the steps."""


def state_code(state: str) -> str:
    """Return the color of a state for the page."""
    return "#{:02x}{:02x}{:02x}".format(*STATE_COLORS.get(State(state), (200, 200, 200)))


def time_figures(members: Sequence[MemberCurves]) -> list[figure]:
    """Return a plot of the error for each member, and one of the confidence of all; they share the time axis."""
    end = max((float(own.time_s[-1]) for own in members if len(own.time_s)), default=0.0)
    span = Range1d(0.0, max(end, 1e-3), bounds="auto")
    plots = [_error_figure(own, span) for own in members]
    confidence = _figure("confidence", span, 180, y_range=Range1d(-0.03, 1.05))
    for number, own in enumerate(members):
        confidence.line(own.time_s, own.confidence, color=_color(number), line_width=2, legend_label=own.name)
    _place_legend(confidence)
    confidence.xaxis.axis_label = "time [s]"
    plots.append(confidence)
    for number, plot in enumerate(plots):
        cursor = Span(location=0.0, dimension="height", line_color="#c00018", line_width=2, name=f"{CURSOR}{number}")
        plot.add_layout(cursor)
        # The page's own function; the event says where in seconds.
        plot.js_on_event(Tap, CustomJS(code="window.report.seek(cb_obj.x)"))
    return plots


def _error_figure(own: MemberCurves, span: Range1d) -> figure:
    """Plot components and norm of the error, with states, switches and closed gates."""
    plot = _figure(f"error [{own.unit}]" if own.unit else "error", span, 330)
    step = float(np.median(np.diff(own.time_s))) if len(own.time_s) > 1 else 0.0
    bands = [(own.time_s[first], own.time_s[last] + step, state) for first, last, state in runs_of(own.state) if state]
    states = ColumnDataSource(
        {
            "x0": [start for start, _, _ in bands],
            "x1": [end for _, end, _ in bands],
            "color": [state_code(state) for *_, state in bands],
        }
    )
    plot.vstrip("x0", "x1", source=states, fill_color="color", fill_alpha=0.16, line_color=None)
    switches = own.time_s[own.switched]
    if len(switches):
        plot.vspan(x=switches, line_color="#777777", line_dash="dotted", legend_label="switch")
    if own.error.shape[1] > 1:
        for row, name in enumerate(own.rows):
            plot.line(own.time_s, own.error[:, row], color=_color(row), line_width=1.2, legend_label=name)
    plot.line(own.time_s, own.norm, color=NORM_COLOR, line_width=2, legend_label="norm")
    if np.isfinite(own.goal_norm).any():
        plot.line(
            own.time_s,
            own.goal_norm,
            color=GOAL_COLOR,
            line_width=2,
            line_dash="dashed",
            legend_label="left to the goal",
        )
    gated = np.isfinite(own.norm) & ~own.is_certain
    if gated.any():
        plot.scatter(
            own.time_s[gated], own.norm[gated], size=6, color=GATE_COLOR, fill_alpha=0.0, legend_label="gate closed"
        )
    _place_legend(plot)
    plot.title.text = own.name
    plot.title.standoff = 2
    return plot


def training_figures(curves: Mapping[str, Mapping[str, Curve]]) -> list[figure]:
    """Return a plot for each metric of the training, smoothed, what it was faintly behind.

    Args:
        curves: of each metric by member (:func:`geoskill.viz.curves.read_training`).
    """
    labels = {"objective": "objective", "reward": "reward", "rsw": "RSW", "error": "control error Ec"}
    plots = []
    for metric, by_member in curves.items():
        positive = [values for _, values in by_member.values() if (values > 0).any()]
        logarithmic = metric == "rsw" and positive
        plot = _figure(labels.get(metric, metric), None, 190, y_axis_type="log" if logarithmic else "linear")
        for number, (member, (steps, values)) in enumerate(by_member.items()):
            for own, alpha, width in ((values, 0.25, 1), (smoothed(values), 1.0, 2)):
                shown = np.where(own > 0, own, np.nan) if logarithmic else own
                label = {"legend_label": member} if width == 2 else {}
                plot.line(steps, shown, color=_color(number), line_alpha=alpha, line_width=width, **label)
        plot.xaxis.axis_label = "step"
        if by_member:
            _place_legend(plot)
            plots.append(plot)
    return plots


def smoothed(values: Float64[np.ndarray, " n"]) -> Float64[np.ndarray, " n"]:
    """Return the running mean of values over a 25th of them; at the ends over those that there are.

    >>> smoothed(np.arange(4.0)).tolist()
    [0.0, 1.0, 2.0, 3.0]
    """
    half = len(values) // SMOOTHING // 2
    sums = np.concatenate([[0.0], np.cumsum(values)])
    place = np.arange(len(values))
    first, last = np.maximum(place - half, 0), np.minimum(place + half + 1, len(values))
    return np.asarray((sums[last] - sums[first]) / (last - first))


def reliability_figure(bins: Mapping[str, Sequence[Sequence[float | None]]]) -> figure:
    """Plot how often associations of a confidence are right; on the diagonal it is as often as they say.

    Args:
        bins: frames by confidence, of each member: how many, their mean confidence, and the share of right ones.
    """
    plot = _figure("share that is right", Range1d(-0.03, 1.05), 300, y_range=Range1d(-0.03, 1.05))
    plot.line([0, 1], [0, 1], color="#999999")
    for number, (name, own) in enumerate(bins.items()):
        count, confidence, accuracy = np.array([row for row in own if row[0]], np.float64).reshape(-1, 3).T
        size = 6 + 24 * np.sqrt(count / max(1.0, count.sum()))
        plot.line(confidence, accuracy, color=_color(number))
        plot.scatter(confidence, accuracy, size=size, color=_color(number), alpha=0.7, legend_label=name)
    plot.xaxis.axis_label = "confidence"
    _place_legend(plot)
    return plot


def _figure(label: str, span: Range1d | None, height: int, **settings: object) -> figure:
    given = {} if span is None else {"x_range": span}
    plot = figure(
        height=height,
        sizing_mode="stretch_width",
        tools=TOOLS,
        # A finger that scrolls the page must not move the curves.
        active_drag=None,
        toolbar_location="right",
        output_backend="canvas",
        **given,
        **settings,
    )
    plot.toolbar.logo = None
    plot.toolbar.autohide = True
    plot.yaxis.axis_label = label
    plot.grid.grid_line_color = "#eeeeee"
    plot.outline_line_color = None
    return plot


def _place_legend(plot: figure) -> None:
    if plot.legend:
        legend = plot.legend[0]
        plot.add_layout(legend, "above")
        legend.orientation = "horizontal"
        legend.click_policy = "hide"
        legend.ncols = 3
        legend.spacing, legend.padding, legend.margin, legend.border_line_color = 6, 2, 2, None
        legend.label_text_font_size = "9pt"


def _color(number: int) -> str:
    return COLORS[number % len(COLORS)]
