"""Frame rates, as plain values, as a table and as a picture."""

from collections.abc import Mapping
from statistics import median
from typing import Any

from matplotlib.figure import Figure

from geoskill.benchmarks.measurement import Figures
from geoskill.benchmarks.table import as_table
from geoskill.viz.curves import COLORS


def relative_rate(figures: Figures, reference: Figures) -> float:
    """The frame rate over that of another way: the median of the rounds, for both ways suffer alike within a round.

    >>> relative_rate(Figures((1.0, 2.0, 3.0)), Figures((2.0, 1.0, 3.0)))
    1.0
    """
    return median(theirs / ours for ours, theirs in zip(figures.seconds, reference.seconds, strict=True))


def plain_rates(ways: Mapping[str, Figures], frames: int, reference: str) -> dict[str, Any]:
    """Plain values, for JSON.

    Args:
        ways: by name, the seconds in which each of them goes through all frames.
        frames: how many these are.
        reference: the way that the others are compared with.
    """
    return {
        name: {
            "frames_per_second": frames / figures.median_s,
            f"over_{reference}": relative_rate(figures, ways[reference]),
            "seconds": list(figures.seconds),
        }
        for name, figures in ways.items()
    }


def rates_table(ways: Mapping[str, Figures], frames: int, reference: str) -> str:
    """A line for each way; the arguments are those of :func:`plain_rates`.

    >>> print(rates_table({"read": Figures((0.1,)), "extract": Figures((0.4,))}, 20, "extract").splitlines()[-2])
    | read | 200 | 4 |
    """
    lines = [
        (name, f"{frames / figures.median_s:.3g}", f"{relative_rate(figures, ways[reference]):.3g}")
        for name, figures in ways.items()
    ]
    return as_table(("work", "frames/s", f"over {reference}"), lines)


def rates_figure(ways: Mapping[str, Figures], frames: int) -> Figure:
    """A bar for each way, as long as its median rate, and a dot for every repetition."""
    figure = Figure(figsize=(8, 0.8 + 0.45 * len(ways)), layout="constrained")
    axes = figure.add_subplot()
    for place, figures in enumerate(ways.values()):
        axes.barh(place, frames / figures.median_s, 0.7, color=COLORS[0], alpha=0.6)
        rates = [frames / seconds for seconds in figures.seconds]
        axes.plot(rates, [place] * len(rates), "o", color="black", markersize=3)
    axes.set_yticks(range(len(ways)), list(ways))
    axes.invert_yaxis()
    axes.set_xscale("log")  # reading is far faster than all else
    axes.set_xlabel("frames per second")
    axes.spines[["top", "right"]].set_visible(False)
    return figure
