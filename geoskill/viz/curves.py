"""Curves of a training run and of an inference run, as PNG images.

Figures are made with matplotlib's object interface, which needs no display, keeps no figure alive and leaves the global
state of pyplot alone.
"""

import csv
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple, TypeAlias, final

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from geoskill.errors import InputError
from geoskill.io.atomic import atomic_path

Curve: TypeAlias = tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"]]
"""Steps or frames, and the value at each of them; NaN leaves a gap."""

# Okabe and Ito's palette, distinct for color-blind people, without its yellow, which is too pale for a line.
COLORS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000")
LINE_STYLES = ("-", "--", ":", "-.")


@final
class _Panel(NamedTuple):
    metric: str
    label: str
    factor: float = 1.0
    logarithmic: bool = False


_TRAINING_PANELS = (
    _Panel("objective", "objective"),
    _Panel("reward", "reward"),
    _Panel("rsw", "RSW [%]", factor=100.0, logarithmic=True),
    _Panel("error", r"$E_c$ [px, m]"),
)


def plot_training(csv_path: Path, picture_path: Path) -> None:
    """Plot objective, reward, RSW (residual sum of weights, in %) and Ec over the steps of a training run.

    Args:
        csv_path: table with a column ``step`` and, for each ensemble member, columns such as ``p2p_sift/objective``,
            ``.../reward``, ``.../rsw`` (a fraction) and ``.../error`` (pixels). Empty and NaN cells are skipped, since
            a row may hold values of some columns only; other columns are ignored.
        picture_path: PNG to write; it is replaced only once the new one is complete.

    Raises:
        InputError: when the table cannot be read, lacks such columns or numbers in them, or a cell is not a number.
    """
    save_figure(training_figure(read_training(csv_path)), picture_path)


def plot_inference(rows: Sequence[tuple[int, str, float, float]], picture_path: Path) -> None:
    """Plot control error and confidence of each ensemble member's top association over the frames.

    Args:
        rows: frame, member, confidence in [0, 1] and norm of the control error in pixels. A frame in which the member
            has no association has no row, or one with NaN: a gap in the curve.
        picture_path: PNG to write; it is replaced only once the new one is complete.
    """
    save_figure(inference_figure(rows), picture_path)


def read_training(csv_path: Path) -> dict[str, dict[str, Curve]]:
    """Read the curves of each metric by member, in the order of the columns.

    The table and the errors are those of :func:`plot_training`.
    """
    try:
        with open(csv_path, encoding="utf-8", newline="") as file:
            table = csv.DictReader(file)
            columns = table.fieldnames or []
            rows = list(table)
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise InputError(f"{csv_path}: cannot be read ({error}); expected a table of training metrics") from error
    metrics = [panel.metric for panel in _TRAINING_PANELS]
    split = {column: column.rsplit("/", 1) for column in columns if "/" in column}
    plotted = {column: (member, metric) for column, (member, metric) in split.items() if metric in metrics}
    if "step" not in columns or not plotted:
        raise InputError(
            f"{csv_path}: its columns are {', '.join(columns) or 'none'}; expected step and, for each member, "
            f"{', '.join(f'<member>/{metric}' for metric in metrics)}"
        )
    curves: dict[str, dict[str, Curve]] = {metric: {} for metric in metrics}
    for column, (member, metric) in plotted.items():
        points = []
        for line, row in enumerate(rows, start=2):
            step, value = (_number(row[name], f"{csv_path} line {line}, {name}") for name in ("step", column))
            if not (math.isnan(step) or math.isnan(value)):
                points.append((step, value))
        if points:
            steps, values = np.asarray(points, np.float64).T
            curves[metric][member] = (steps, values)
    if not any(curves.values()):
        raise InputError(f"{csv_path}: the table holds no number; expected at least one step of training")
    return curves


def training_figure(curves: Mapping[str, Mapping[str, Curve]]) -> Figure:
    """Draw four panels with a line per member: objective, reward, RSW in % (from a fraction) and error in pixels."""
    figure = Figure(figsize=(9.0, 6.0), dpi=150, layout="constrained")
    members = list(dict.fromkeys(member for by_member in curves.values() for member in by_member))
    for axes, panel in zip(figure.subplots(2, 2, sharex=True).flat, _TRAINING_PANELS, strict=True):
        by_member = curves.get(panel.metric, {})
        _draw_curves(axes, {member: (x, panel.factor * y) for member, (x, y) in by_member.items()}, members)
        axes.set_ylabel(panel.label)
        # A logarithmic axis without any positive number has no range.
        if panel.logarithmic and any((y > 0).any() for _, y in by_member.values()):
            axes.set_yscale("log", nonpositive="mask")
        if axes.get_subplotspec().is_last_row():
            axes.set_xlabel("step")
    _add_legend(figure, members)
    return figure


def inference_figure(rows: Sequence[tuple[int, str, float, float]]) -> Figure:
    """Draw two panels over the frames, error above confidence; see :func:`plot_inference`."""
    figure = Figure(figsize=(9.0, 5.0), dpi=150, layout="constrained")
    error_axes, confidence_axes = figure.subplots(2, 1, sharex=True)
    members = list(dict.fromkeys(member for _, member, _, _ in rows))
    frames = sorted({frame for frame, *_ in rows})
    errors: dict[str, Curve] = {}
    confidences: dict[str, Curve] = {}
    for member in members:
        by_frame = {frame: (confidence, norm) for frame, name, confidence, norm in rows if name == member}
        values = np.array([by_frame.get(frame, (math.nan, math.nan)) for frame in frames], np.float64)
        confidences[member] = (np.asarray(frames, np.float64), values[:, 0])
        errors[member] = (np.asarray(frames, np.float64), values[:, 1])
    _draw_curves(error_axes, errors, members)
    _draw_curves(confidence_axes, confidences, members)
    error_axes.set_ylabel(r"control error $\|E\|$ [px, m]")
    error_axes.set_ylim(bottom=0.0)
    confidence_axes.set_ylabel("confidence")
    confidence_axes.set_ylim(0.0, 1.03)
    confidence_axes.set_xlabel("frame")
    _add_legend(figure, members)
    return figure


def _draw_curves(axes: Axes, curves: Mapping[str, Curve], members: Sequence[str]) -> None:
    axes.grid(True, color="0.9", linewidth=0.8)
    axes.set_axisbelow(True)
    axes.spines[["top", "right"]].set_visible(False)
    axes.margins(x=0.02)
    for member, (x, y) in curves.items():
        number = members.index(member)
        axes.plot(
            x,
            y,
            label=member,
            color=COLORS[number % len(COLORS)],
            linestyle=LINE_STYLES[number // len(COLORS) % len(LINE_STYLES)],
            linewidth=1.4,
            # A value between two gaps, or the only one, has no line.
            marker=".",
            markersize=3.0,
        )
    if not any(np.isfinite(y).any() for _, y in curves.values()):
        axes.text(0.5, 0.5, "no data", transform=axes.transAxes, ha="center", va="center", color="0.5")


def _add_legend(figure: Figure, members: Sequence[str]) -> None:
    handles = {str(line.get_label()): line for axes in figure.axes for line in axes.get_lines()}
    if handles:
        figure.legend(
            [handles[member] for member in members if member in handles],
            [member for member in members if member in handles],
            loc="outside upper center",
            ncols=min(4, len(handles)),
            frameon=False,
        )


def _number(text: str | None, cell: str) -> float:
    if text is None or not text.strip():
        return math.nan
    try:
        return float(text)
    except ValueError as error:
        raise InputError(f"{cell}: {text!r} is not a number; expected one or an empty cell") from error


def save_figure(figure: Figure, path: Path) -> None:
    """Write a figure as PNG; an existing file is replaced only once the new one is complete."""
    with atomic_path(path) as temporary:
        figure.savefig(temporary, format="png")
