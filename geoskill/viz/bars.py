"""Pictures of several trainings: accuracy, calibration, learning curves and the summary of a sweep."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure

from geoskill.viz.curves import COLORS, LINE_STYLES, read_training, save_figure

if TYPE_CHECKING:
    import pandas as pd

TITLES = {"top1_accuracy": "top-1 accuracy", "rsw": "RSW"}


def plot_bars(
    test_sets: Sequence[str],
    variants: Mapping[str, Sequence[Sequence[float]]],
    published: Mapping[str, Mapping[str, float]],
    picture_path: Path,
) -> None:
    """Draw mean top-1 accuracy per variant and test set, a dot for each seed, a line for a published value.

    Args:
        test_sets: their names, each of a color.
        variants: for each variant, the percentages of its seeds on every test set.
        published: percent by row and test set; rows that are only published get bars of their own.
        picture_path: the PNG to write.
    """
    alone = {
        name: [[percent[test_set]] if test_set in percent else [] for test_set in test_sets]
        for name, percent in published.items()
        if name not in variants
    }
    bars = {**variants, **alone}
    pitch = len(test_sets) + 0.7
    figure = Figure(figsize=(9, 0.9 + 0.2 * pitch * len(bars)), layout="constrained")
    axes = figure.add_subplot()
    for row, (name, values) in enumerate(bars.items()):
        for column, (test_set, seeds) in enumerate(zip(test_sets, values, strict=True)):
            y = row * pitch + column
            label = test_set.replace("_", " ") if row == 0 else None
            width = float(np.mean(seeds)) if len(seeds) else 0.0
            axes.barh(y, width, 0.85, color=COLORS[column % len(COLORS)], alpha=0.6, label=label)
            if name in variants:
                axes.plot(seeds, [y] * len(seeds), "o", color="black", markersize=3)
                known = published.get(name, {}).get(test_set)
                if known is not None:
                    axes.plot([known, known], [y - 0.43, y + 0.43], color="black", linewidth=2.5)
    middle = (len(test_sets) - 1) / 2
    axes.set_yticks([row * pitch + middle for row in range(len(bars))], list(bars))
    axes.invert_yaxis()
    axes.set_xlim(0, 103)
    axes.set_xlabel("top-1 accuracy [%]; dots: seeds, black line: published")
    axes.spines[["top", "right"]].set_visible(False)
    figure.legend(loc="outside upper center", ncols=4, frameon=False)
    save_figure(figure, picture_path)


def plot_reliability(variants: Mapping[str, Sequence[tuple[int, float, float]]], picture_path: Path) -> None:
    """Draw how often associations of a confidence are right; a variant on the diagonal is calibrated.

    Args:
        variants: frames by confidence: how many, their mean confidence, and the share of right ones. The area of a dot
            tells how many.
        picture_path: the PNG to write.
    """
    figure = Figure(figsize=(4.6, 4.6), layout="constrained")
    axes = figure.add_subplot()
    axes.plot([0, 1], [0, 1], color="0.6", linewidth=1)
    for number, (variant, bins) in enumerate(variants.items()):
        filled = [reliability_bin for reliability_bin in bins if reliability_bin[0]]
        frames, confidence, accuracy = np.array(filled).reshape(-1, 3).T
        color = COLORS[number % len(COLORS)]
        axes.plot(confidence, accuracy, color=color, linewidth=1, label=variant)
        axes.scatter(confidence, accuracy, 8 + 250 * frames / max(1, frames.sum()), color=color)
    axes.set(xlim=(-0.03, 1.03), ylim=(-0.03, 1.03), xlabel="confidence", ylabel="share of right associations")
    axes.spines[["top", "right"]].set_visible(False)
    figure.legend(loc="outside upper center", ncols=2, frameon=False)
    save_figure(figure, picture_path)


def plot_trainings(tables: Mapping[str, Sequence[Path]], picture_path: Path) -> None:
    """Draw objective and RSW over the steps, for each variant the mean of its seeds and the band between them.

    Args:
        tables: the ``metrics.csv`` of every seed by variant; of an ensemble the first member is drawn.
        picture_path: the PNG to write.
    """
    figure = Figure(figsize=(9, 3.6), layout="constrained")
    panels = figure.subplots(1, 2)
    for number, (variant, paths) in enumerate(tables.items()):
        color, style = COLORS[number % len(COLORS)], LINE_STYLES[number // len(COLORS) % len(LINE_STYLES)]
        for axes, quantity, factor in zip(panels, ("objective", "rsw"), (1.0, 100.0), strict=True):
            curves = [next(iter(read_training(path)[quantity].values())) for path in paths]
            shortest = min(len(steps) for steps, _ in curves)
            values = factor * np.stack([values[:shortest] for _, values in curves])
            # Some steps at a time: single batches are noisy.
            width = max(1, shortest // 40)
            blocks = values[:, : shortest // width * width].reshape(len(values), -1, width).mean(axis=2)
            steps = (np.arange(blocks.shape[1]) + 0.5) * width
            label = variant if quantity == "rsw" else None
            axes.plot(steps, blocks.mean(axis=0), color=color, linestyle=style, label=label)
            axes.fill_between(steps, blocks.min(axis=0), blocks.max(axis=0), color=color, alpha=0.2, linewidth=0)
    for axes, label in zip(panels, ("objective", "RSW [%]"), strict=True):
        axes.set_xlabel("step")
        axes.set_ylabel(label)
        axes.spines[["top", "right"]].set_visible(False)
    panels[1].set_yscale("symlog", linthresh=0.01)  # RSW can be exactly zero
    panels[1].set_ylim(bottom=0)
    figure.legend(loc="outside upper center", ncols=3, frameon=False)
    save_figure(figure, picture_path)


def plot_summary(summary: pd.DataFrame, by: Sequence[str], metrics: Sequence[str], picture_path: Path) -> None:
    """Draw a panel per metric: its mean and standard deviation over the seeds for each setting.

    Args:
        summary: one row per setting; for each metric a column, and one with ``_sd`` behind its name.
        by: the columns that tell settings apart.
        metrics: in the order of the panels.
        picture_path: the PNG to write.
    """
    settings = summary[list(by)].astype(object).where(summary[list(by)].notna(), "").astype(str)
    names = [", ".join(filter(None, row)) or "all runs" for row in settings.itertuples(index=False)]
    slant = {"rotation": 30, "ha": "right", "rotation_mode": "anchor"} if max(map(len, names)) > 6 else {}
    figure = Figure(figsize=(3.2 * len(metrics), 3.2), dpi=120, layout="constrained")
    for axes, metric in zip(figure.subplots(1, len(metrics), squeeze=False)[0], metrics, strict=True):
        deviations = summary[f"{metric}_sd"].fillna(0.0)
        axes.errorbar(range(len(names)), summary[metric], yerr=deviations, marker="o", linestyle="none", capsize=4)
        axes.set_xticks(range(len(names)), names, **slant)
        axes.set_title(TITLES.get(metric, metric.replace("_", " ")))
        axes.grid(alpha=0.3)
    figure.supxlabel(f"{', '.join(by)} (mean and standard deviation over the seeds)".lstrip())
    save_figure(figure, picture_path)
