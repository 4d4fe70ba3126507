"""What was measured, as JSON, as a table and as a picture."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, final

from matplotlib.figure import Figure

from geoskill.benchmarks.measurement import Figures
from geoskill.viz.curves import COLORS, save_figure

STYLES = {"ours": "o-", "cascade": "v-.", "plain": "s--", "products": "^:"}


@final
@dataclass(frozen=True)
class Row:
    """One case and the figures of each of its ways.

    Attributes:
        kernel: of the case.
        model: of the case.
        precision: of the case.
        features: of the case.
        instances: how many there are.
        ways: by name; ``ours`` is always there.
    """

    kernel: str
    model: str
    precision: str
    features: int
    instances: int
    ways: Mapping[str, Figures]

    def plain(self) -> dict[str, Any]:
        """Plain values, for JSON."""
        return {
            "kernel": self.kernel,
            "model": self.model,
            "precision": self.precision,
            "features": self.features,
            "instances": self.instances,
            **{
                name: {"median_s": way.median_s, "seconds": list(way.seconds), "peak_mb": way.peak_mb}
                for name, way in self.ways.items()
            },
        }


HEAD = (
    "kernel",
    "model",
    "precision",
    "n",
    "instances",
    "ours [ms]",
    "plain / ours",
    "ours / products",
    "ours / cascade",
    "ours [MiB]",
    "cascade [MiB]",
    "plain [MiB]",
)


def markdown(rows: Sequence[Row]) -> str:
    """A table of medians, and of their ratios.

    >>> ways = {"ours": Figures((0.2, 0.1, 0.3), 10.0), "plain": Figures((0.8, 0.8, 0.7), 40.0)}
    >>> print(markdown([Row("p2p", "paper", "float32", 60, 1770, ways)]).splitlines()[-1])
    | p2p | paper | float32 | 60 | 1770 | 200 | 4.00 |  |  | 10 |  | 40 |
    """
    lines = []
    for row in rows:
        ours, cascade, plain, products = (row.ways.get(name) for name in ("ours", "cascade", "plain", "products"))
        assert ours is not None
        lines.append(
            (
                row.kernel,
                row.model,
                row.precision,
                str(row.features),
                str(row.instances),
                f"{1000 * ours.median_s:.3g}",
                "" if plain is None else f"{plain.median_s / ours.median_s:.2f}",
                "" if products is None else f"{ours.median_s / products.median_s:.2f}",
                "" if cascade is None else f"{ours.median_s / cascade.median_s:.2f}",
                _memory(ours),
                _memory(cascade),
                _memory(plain),
            )
        )
    return as_table(HEAD, lines)


def as_table(head: Sequence[str], lines: Sequence[Sequence[str]]) -> str:
    """A table in Markdown."""
    return "\n".join(f"| {' | '.join(line)} |" for line in (head, ("---",) * len(head), *lines)) + "\n"


def _memory(figures: Figures | None) -> str:
    return "" if figures is None or figures.peak_mb is None else f"{figures.peak_mb:.0f}"


def write_report(rows: Sequence[Row], machine: Mapping[str, Any], folder: Path, name: str) -> None:
    """``NAME.json``, ``NAME.md`` and ``NAME.png`` in a folder."""
    content = {"machine": dict(machine), "rows": [row.plain() for row in rows]}
    write_files(content, markdown(rows), growth_figure(rows), folder, name)


def write_files(content: Mapping[str, Any], table: str, figure: Figure, folder: Path, name: str) -> None:
    """``NAME.json``, ``NAME.md`` and ``NAME.png``, whatever is in them."""
    (folder / f"{name}.json").write_text(json.dumps(content, indent=2), encoding="utf-8")
    (folder / f"{name}.md").write_text(table, encoding="utf-8")
    save_figure(figure, folder / f"{name}.png")


def growth_figure(rows: Sequence[Row]) -> Figure:
    """Time and memory over the number of features, a line for each kernel, model, precision and way."""
    figure = Figure(figsize=(11, 4.5), layout="constrained")
    left, right = figure.subplots(1, 2)
    cases = list(dict.fromkeys((row.kernel, row.model, row.precision) for row in rows))
    for number, case in enumerate(cases):
        of_case = [row for row in rows if (row.kernel, row.model, row.precision) == case]
        for way, style in STYLES.items():
            color, label = COLORS[number % len(COLORS)], f"{' '.join(case)}, {way}"
            known = [row for row in of_case if way in row.ways]
            if known:
                counts = [row.features for row in known]
                left.plot(counts, [row.ways[way].median_s for row in known], style, color=color, label=label)
            held = [(row.features, row.ways[way].peak_mb) for row in known if row.ways[way].peak_mb is not None]
            if held:
                right.plot(*zip(*held, strict=True), style, color=color)
    for axes, label in ((left, "seconds"), (right, "peak memory [MiB]")):
        axes.set_xscale("log")
        axes.set_yscale("log")
        axes.set_xlabel("features of each type")
        axes.set_ylabel(label)
    left.legend(fontsize="x-small")
    return figure
