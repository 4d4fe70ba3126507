"""What a sweep found: one table and one plot over all its runs, written when the last one has ended."""

from __future__ import annotations

import csv
import json
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from statistics import mean, stdev
from typing import Any, final

from hydra.experimental.callback import Callback
from omegaconf import DictConfig, OmegaConf

from geoskill.cli.command import FAILED_RUN

# The figures of a run's metrics.json that are worth comparing, where a run has them.
FIGURES = ("top1_accuracy", "objective", "rsw", "mean_confidence", "steps")


@final
class SweepSummary(Callback):
    """Writes ``summary.md``, ``summary.csv``, ``summary.json`` and ``summary.png`` into the sweep's folder."""

    def on_multirun_end(self, config: DictConfig, **kwargs: Any) -> None:
        """Called by Hydra after the last job; when some have failed, says so and ends with the first one's status."""
        folder = Path(config.hydra.sweep.dir)
        runs = read_runs(folder)
        if runs:
            rows = summarize(runs)
            write_summary(rows, folder)
            print((folder / "summary.md").read_text(encoding="utf-8"))
        print(folder.resolve(), flush=True)
        failures = _in_order(folder, FAILED_RUN)
        if failures:
            status, _, message = failures[0].read_text(encoding="utf-8").strip().partition(" ")
            print(f"error: {len(failures)} run(s) failed, first {failures[0].parent}: {message}", file=sys.stderr)
            sys.exit(int(status))


def read_runs(folder: Path) -> list[tuple[dict[str, str], dict[str, Any]]]:
    """Overrides and figures of every complete run of a sweep, in the order of its jobs."""
    runs = []
    for metrics in _in_order(folder, "metrics.json"):
        if metrics.with_name(FAILED_RUN).exists():  # these are figures of an earlier run in the same folder
            continue
        overrides = OmegaConf.load(metrics.parent / ".hydra" / "overrides.yaml")
        pairs = {key: value for key, _, value in (str(override).partition("=") for override in overrides)}
        runs.append((pairs, json.loads(metrics.read_text(encoding="utf-8"))))
    return runs


def _in_order(folder: Path, name: str) -> list[Path]:
    """The file of every job that has it, the tenth job after the ninth."""
    return sorted(folder.glob(f"*/{name}"), key=lambda path: (len(path.parent.name), path.parent.name))


def summarize(runs: Sequence[tuple[Mapping[str, str], Mapping[str, Any]]]) -> list[dict[str, Any]]:
    """One row for each setting that was swept: mean and standard deviation over the seeds.

    Overrides that are the same in all runs are left out; ``seed`` is what a row averages over. A row has the swept
    keys, ``runs``, and for each figure ``NAME`` and ``NAME_sd`` (None for a single run).
    """
    keys = [key for key in dict.fromkeys(key for pairs, _ in runs for key in pairs) if key != "seed"]
    swept = [key for key in keys if len({pairs.get(key) for pairs, _ in runs}) > 1]
    groups: dict[tuple[str | None, ...], list[Mapping[str, Any]]] = {}
    for pairs, figures in runs:
        groups.setdefault(tuple(pairs.get(key) for key in swept), []).append(figures)
    rows = []
    for values, members in groups.items():
        row: dict[str, Any] = {**dict(zip(swept, values, strict=True)), "runs": len(members)}
        for figure in FIGURES:
            numbers = [float(each[figure]) for each in members if each.get(figure) is not None]
            if numbers:
                row[figure] = mean(numbers)
                row[f"{figure}_sd"] = stdev(numbers) if len(numbers) > 1 else None
        rows.append(row)
    return rows


def write_summary(rows: Sequence[Mapping[str, Any]], folder: Path) -> None:
    """The table as Markdown, CSV and JSON, and its plot."""
    columns = list(dict.fromkeys(key for row in rows for key in row))
    (folder / "summary.json").write_text(json.dumps(list(rows), indent=2), encoding="utf-8")
    with (folder / "summary.csv").open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, fieldnames=columns)
        writer.writeheader()
        writer.writerows(rows)
    shown = [column for column in columns if not column.endswith("_sd")]
    lines = ["| " + " | ".join(shown) + " |", "|" + "---|" * len(shown)]
    lines += ["| " + " | ".join(_cell(row, column) for column in shown) + " |" for row in rows]
    (folder / "summary.md").write_text("\n".join(lines) + "\n", encoding="utf-8")
    _plot(rows, [figure for figure in FIGURES if figure in columns and figure != "steps"], folder / "summary.png")


def _cell(row: Mapping[str, Any], column: str) -> str:
    value, spread = row.get(column), row.get(f"{column}_sd")
    if not isinstance(value, float):
        return "" if value is None else str(value)
    return f"{value:.4g}" if spread is None else f"{value:.4g} ± {spread:.2g}"


def _plot(rows: Sequence[Mapping[str, Any]], figures: Sequence[str], path: Path) -> None:
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    names = [
        ", ".join(str(value) for key, value in row.items() if isinstance(value, str)) or "all runs" for row in rows
    ]
    picture = Figure(figsize=(3.2 * len(figures), 3.2), layout="constrained")
    FigureCanvasAgg(picture)
    for axes, figure in zip(picture.subplots(1, len(figures), squeeze=False)[0], figures, strict=True):
        values = [row.get(figure, float("nan")) for row in rows]
        spreads = [row.get(f"{figure}_sd") or 0.0 for row in rows]
        axes.errorbar(range(len(rows)), values, yerr=spreads, marker="o", linestyle="none", capsize=4)
        slanted = {"rotation": 30, "ha": "right", "rotation_mode": "anchor"} if max(map(len, names)) > 6 else {}
        axes.set_xticks(range(len(rows)), names, **slanted)
        axes.set_title({"top1_accuracy": "top-1 accuracy", "rsw": "RSW"}.get(figure, figure.replace("_", " ")))
        axes.grid(alpha=0.3)
    swept = [key for key, value in rows[0].items() if isinstance(value, str)]
    picture.supxlabel(f"{', '.join(swept)} (mean and standard deviation over the seeds)".lstrip())
    picture.savefig(path, dpi=120)
