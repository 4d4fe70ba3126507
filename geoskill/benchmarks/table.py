"""Reports of what was measured, as JSON, as a Markdown table and as a plot."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, final

from matplotlib.figure import Figure

from geoskill.benchmarks.measurement import Metrics
from geoskill.viz.curves import COLORS, save_figure

LINE_STYLES = {"dense": "o-", "cascade": "v-.", "pyg": "s--", "matmul_bound": "^:"}


@final
@dataclass(frozen=True, eq=False)
class Row:
    """The metrics of one case.

    Attributes:
        kernel: name of the kernel.
        model: name of the network.
        precision: of the network.
        features: number of features of each node type.
        instances: number of instances.
        metrics: by the name of the variant; ``dense`` is always present.
    """

    kernel: str
    model: str
    precision: str
    features: int
    instances: int
    metrics: Mapping[str, Metrics]

    def to_dict(self) -> dict[str, Any]:
        """Return the row as plain values, for JSON."""
        return {
            "kernel": self.kernel,
            "model": self.model,
            "precision": self.precision,
            "features": self.features,
            "instances": self.instances,
            **{
                variant: {
                    "median_s": metrics.timing.median,
                    "seconds": metrics.timing.times,
                    "peak_mb": metrics.peak_mb,
                }
                for variant, metrics in self.metrics.items()
            },
        }


HEADER = (
    "kernel",
    "model",
    "precision",
    "n",
    "instances",
    "dense [ms]",
    "pyg / dense",
    "dense / matmul bound",
    "dense / cascade",
    "dense [MiB]",
    "cascade [MiB]",
    "pyg [MiB]",
)


def markdown(rows: Sequence[Row]) -> str:
    """Format rows as a table of median times, their ratios, and peak memory.

    >>> from geoskill.benchmarks.measurement import single_runs
    >>> dense, pyg = Metrics(single_runs([0.2, 0.1, 0.3]), 10.0), Metrics(single_runs([0.8, 0.8, 0.7]), 40.0)
    >>> print(markdown([Row("p2p", "paper", "float32", 60, 1770, {"dense": dense, "pyg": pyg})]).splitlines()[-1])
    | p2p | paper | float32 | 60 | 1770 | 200 | 4.00 |  |  | 10 |  | 40 |
    """
    lines = []
    for row in rows:
        dense = row.metrics["dense"]
        cascade, pyg, bound = (row.metrics.get(variant) for variant in ("cascade", "pyg", "matmul_bound"))
        lines.append(
            (
                row.kernel,
                row.model,
                row.precision,
                str(row.features),
                str(row.instances),
                f"{1000 * dense.timing.median:.3g}",
                _ratio(pyg, dense),
                _ratio(dense, bound),
                _ratio(dense, cascade),
                _memory(dense),
                _memory(cascade),
                _memory(pyg),
            )
        )
    return format_table(HEADER, lines)


def format_table(header: Sequence[str], lines: Sequence[Sequence[str]]) -> str:
    """Format a table in Markdown."""
    return "\n".join(f"| {' | '.join(line)} |" for line in (header, ("---",) * len(header), *lines)) + "\n"


def _ratio(numerator: Metrics | None, denominator: Metrics | None) -> str:
    if numerator is None or denominator is None:
        return ""
    return f"{numerator.timing.median / denominator.timing.median:.2f}"


def _memory(metrics: Metrics | None) -> str:
    return "" if metrics is None or metrics.peak_mb is None else f"{metrics.peak_mb:.0f}"


def write_report(rows: Sequence[Row], machine: Mapping[str, Any], folder: Path, name: str) -> None:
    """Write rows to ``NAME.json``, ``NAME.md`` and ``NAME.png`` in a folder."""
    content = {"machine": dict(machine), "rows": [row.to_dict() for row in rows]}
    write_files(content, markdown(rows), growth_figure(rows), folder, name)


def write_files(content: Mapping[str, Any], table: str, figure: Figure | None, folder: Path, name: str) -> None:
    """Write a report's content to ``NAME.json``, its table to ``NAME.md`` and its plot, if any, to ``NAME.png``."""
    (folder / f"{name}.json").write_text(json.dumps(content, indent=2), encoding="utf-8")
    (folder / f"{name}.md").write_text(table, encoding="utf-8")
    if figure is not None:
        save_figure(figure, folder / f"{name}.png")


def growth_figure(rows: Sequence[Row]) -> Figure:
    """Plot time and memory over the number of features, a line for each kernel, model, precision and variant."""
    figure = Figure(figsize=(11, 4.5), layout="constrained")
    left, right = figure.subplots(1, 2)
    cases = list(dict.fromkeys((row.kernel, row.model, row.precision) for row in rows))
    for number, case in enumerate(cases):
        color = COLORS[number % len(COLORS)]
        case_rows = [row for row in rows if (row.kernel, row.model, row.precision) == case]
        for variant, style in LINE_STYLES.items():
            measured = [(row.features, row.metrics[variant]) for row in case_rows if variant in row.metrics]
            if measured:
                counts = [features for features, _ in measured]
                medians = [metrics.timing.median for _, metrics in measured]
                left.plot(counts, medians, style, color=color, label=f"{' '.join(case)}, {variant}")
            peaks = [(features, metrics.peak_mb) for features, metrics in measured if metrics.peak_mb is not None]
            if peaks:
                right.plot(*zip(*peaks, strict=True), style, color=color)
    for axes, label in ((left, "seconds"), (right, "peak memory [MiB]")):
        axes.set_xscale("log")
        axes.set_yscale("log")
        axes.set_xlabel("features of each type")
        axes.set_ylabel(label)
    left.legend(fontsize="x-small")
    return figure
