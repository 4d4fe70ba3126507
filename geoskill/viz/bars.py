"""Bars of accuracy over several trainings, and the curves of several trainings in one picture."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from geoskill.viz.curves import COLORS, read_training, save_figure


def plot_bars(
    tests: Sequence[str],
    rows: Mapping[str, Sequence[Sequence[float]]],
    published: Mapping[str, Mapping[str, float]],
    picture_path: Path,
) -> None:
    """Mean top-1 accuracy per row and test, with a dot for every seed and a line where a value was published.

    Args:
        tests: their names, each of a color.
        rows: for each row, the percentages of its seeds in every test.
        published: percent by row and test; rows that are only published get bars of their own.
        picture_path: the PNG to write.
    """
    alone = {row: [[values[test]] if test in values else [] for test in tests] for row, values in published.items()}
    bars = {**rows, **{row: values for row, values in alone.items() if row not in rows}}
    pitch = len(tests) + 0.7
    figure = Figure(figsize=(9, 0.9 + 0.2 * pitch * len(bars)), layout="constrained")
    axes = figure.add_subplot()
    for place, (row, values) in enumerate(bars.items()):
        for number, (test, seeds) in enumerate(zip(tests, values, strict=True)):
            at = place * pitch + number
            label = test.replace("_", " ") if place == 0 else None
            width = float(np.mean(seeds)) if len(seeds) else 0.0
            axes.barh(at, width, 0.85, color=COLORS[number % len(COLORS)], alpha=0.6, label=label)
            if row in rows:
                axes.plot(seeds, [at] * len(seeds), "o", color="black", markersize=3)
                known = published.get(row, {}).get(test)
                if known is not None:
                    axes.plot([known, known], [at - 0.43, at + 0.43], color="black", linewidth=2.5)
    middle = (len(tests) - 1) / 2
    axes.set_yticks([place * pitch + middle for place in range(len(bars))], list(bars))
    axes.invert_yaxis()
    axes.set_xlim(0, 103)
    axes.set_xlabel("top-1 accuracy [%]; dots: seeds, black line: published")
    axes.spines[["top", "right"]].set_visible(False)
    figure.legend(loc="outside upper center", ncols=4, frameon=False)
    save_figure(figure, picture_path)


def plot_reliability(rows: Mapping[str, Sequence[tuple[int, float, float]]], picture_path: Path) -> None:
    """How often associations of a confidence are right, for each row; a skill on the diagonal is calibrated.

    Args:
        rows: frames by confidence: how many, their mean confidence, and the share of right ones. A dot's area is how
            many.
        picture_path: the PNG to write.
    """
    figure = Figure(figsize=(4.6, 4.6), layout="constrained")
    axes = figure.add_subplot()
    axes.plot([0, 1], [0, 1], color="0.6", linewidth=1)
    for number, (row, bins) in enumerate(rows.items()):
        frames, confidence, accuracy = np.array([each for each in bins if each[0]]).reshape(-1, 3).T
        color = COLORS[number % len(COLORS)]
        axes.plot(confidence, accuracy, color=color, linewidth=1, label=row)
        axes.scatter(confidence, accuracy, 8 + 250 * frames / max(1, frames.sum()), color=color)
    axes.set(xlim=(-0.03, 1.03), ylim=(-0.03, 1.03), xlabel="confidence", ylabel="share of right associations")
    axes.spines[["top", "right"]].set_visible(False)
    figure.legend(loc="outside upper center", ncols=2, frameon=False)
    save_figure(figure, picture_path)


def plot_trainings(tables: Mapping[str, Sequence[Path]], picture_path: Path) -> None:
    """Objective and RSW over the steps, for each row the mean of its seeds and the band between them.

    Args:
        tables: the ``metrics.csv`` of every seed by row; of several members the first is drawn.
        picture_path: the PNG to write.
    """
    figure = Figure(figsize=(9, 3.6), layout="constrained")
    panels = figure.subplots(1, 2)
    for color, (row, paths) in zip(COLORS, tables.items(), strict=False):
        for axes, quantity, factor in zip(panels, ("objective", "rsw"), (1.0, 100.0), strict=True):
            curves = [next(iter(read_training(path)[quantity].values())) for path in paths]
            shortest = min(len(steps) for steps, _ in curves)
            values = factor * np.stack([values[:shortest] for _, values in curves])
            # Some steps at a time: single batches are noisy.
            width = max(1, shortest // 40)
            blocks = values[:, : shortest // width * width].reshape(len(values), -1, width).mean(axis=2)
            steps = (np.arange(blocks.shape[1]) + 0.5) * width
            axes.plot(steps, blocks.mean(axis=0), color=color, label=row if quantity == "rsw" else None)
            axes.fill_between(steps, blocks.min(axis=0), blocks.max(axis=0), color=color, alpha=0.2, linewidth=0)
    for axes, label in zip(panels, ("objective", "RSW [%]"), strict=True):
        axes.set_xlabel("step")
        axes.set_ylabel(label)
        axes.spines[["top", "right"]].set_visible(False)
    panels[1].set_yscale("symlog", linthresh=0.01)  # RSW can be exactly zero
    panels[1].set_ylim(bottom=0)
    figure.legend(loc="outside upper center", ncols=3, frameon=False)
    save_figure(figure, picture_path)
