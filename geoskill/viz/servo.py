"""Curves of a benchmark of servoing."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from geoskill.viz.curves import COLORS, save_figure

PANELS = (("rms_px", "error [px]"), ("mm", "distance [mm]"), ("deg", "angle [°]"))


def plot_trials(
    trials: Mapping[int, Mapping[str, Sequence[float]]], picture_path: Path, bounds: Mapping[str, float]
) -> None:
    """Plot error, distance and angle of all trials over their frames, and the median of them all.

    Args:
        trials: columns ``rms_px``, ``mm`` and ``deg``, frame by frame, of each trial; NaN leaves a gap.
        picture_path: PNG to write.
        bounds: values that are drawn as lines, by column: up to which a trial is a success.
    """
    figure = Figure(figsize=(7, 7), layout="constrained")
    for axes, (column, label) in zip(figure.subplots(len(PANELS), 1, sharex=True), PANELS, strict=True):
        longest = max(len(own[column]) for own in trials.values())
        table = np.full((len(trials), longest), np.nan)
        for row, own in zip(table, trials.values(), strict=True):
            row[: len(own[column])] = np.maximum(own[column], 1e-2)
        axes.plot(table.T, color=COLORS[0], alpha=max(0.08, min(0.6, 5 / len(trials))), linewidth=0.8)
        shown = np.isfinite(table).mean(axis=0) >= 0.5
        median = [np.nanmedian(column) if enough else np.nan for column, enough in zip(table.T, shown, strict=True)]
        axes.plot(median, color=COLORS[1], linewidth=1.8, label="median of the trials that go on")
        if column in bounds:
            axes.axhline(bounds[column], color=COLORS[6], linestyle=":", linewidth=1, label="success")
        axes.set_yscale("log")
        axes.set_ylabel(label)
        axes.grid(alpha=0.3)
    axes.set_xlabel("frame")
    axes.legend(loc="upper right", fontsize=8)
    save_figure(figure, picture_path)
