"""Frame rates, as plain values, as a table and as a plot."""

from collections.abc import Mapping
from statistics import median
from typing import Any

from matplotlib.figure import Figure
from torch.utils.benchmark import Measurement

from geoskill.benchmarks.table import format_table
from geoskill.viz.curves import COLORS


def relative_rate(timing: Measurement, reference: Measurement) -> float:
    """Return the frame rate relative to a reference: the median over the rounds of the ratio within a round.

    A disturbance of the machine changes both times of a round, and so hardly their ratio.

    >>> from geoskill.benchmarks.measurement import single_runs
    >>> relative_rate(single_runs([1.0, 2.0, 3.0]), single_runs([2.0, 1.0, 3.0]))
    1.0
    """
    rounds = zip(timing.times, reference.times, strict=True)
    return median(reference_seconds / seconds for seconds, reference_seconds in rounds)


def rates_dict(timings: Mapping[str, Measurement], frames: int, reference: str) -> dict[str, Any]:
    """Return frame rates as plain values, for JSON.

    Args:
        timings: by the workload's name; every run goes through all frames.
        frames: number of frames.
        reference: name of the workload that the others are compared with.
    """
    return {
        name: {
            "frames_per_second": frames / timing.median,
            f"over_{reference}": relative_rate(timing, timings[reference]),
            "seconds": timing.times,
        }
        for name, timing in timings.items()
    }


def rates_table(timings: Mapping[str, Measurement], frames: int, reference: str) -> str:
    """Format frame rates as a table with a line for each workload; the arguments are those of :func:`rates_dict`.

    >>> from geoskill.benchmarks.measurement import single_runs
    >>> timings = {"read": single_runs([0.1]), "extract": single_runs([0.4])}
    >>> print(rates_table(timings, 20, "extract").splitlines()[-2])
    | read | 200 | 4 |
    """
    lines = [
        (name, f"{frames / timing.median:.3g}", f"{relative_rate(timing, timings[reference]):.3g}")
        for name, timing in timings.items()
    ]
    return format_table(("work", "frames/s", f"over {reference}"), lines)


def rates_figure(timings: Mapping[str, Measurement], frames: int) -> Figure:
    """Plot a bar for each workload, as long as its median rate, and a dot for every round."""
    figure = Figure(figsize=(8, 0.8 + 0.45 * len(timings)), layout="constrained")
    axes = figure.add_subplot()
    for position, timing in enumerate(timings.values()):
        axes.barh(position, frames / timing.median, 0.7, color=COLORS[0], alpha=0.6)
        rates = [frames / seconds for seconds in timing.times]
        axes.plot(rates, [position] * len(rates), "o", color="black", markersize=3)
    axes.set_yticks(range(len(timings)), list(timings))
    axes.invert_yaxis()
    axes.set_xscale("log")  # reading is far faster than everything else
    axes.set_xlabel("frames per second")
    axes.spines[["top", "right"]].set_visible(False)
    return figure
