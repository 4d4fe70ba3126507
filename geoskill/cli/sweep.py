"""The summary of a sweep, ``python train.py -m``: one table and one plot over all its runs."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, final

import yaml
from hydra.core.utils import JobReturn
from hydra.experimental.callback import Callback
from hydra.types import RunMode
from omegaconf import DictConfig

from geoskill.cli.command import FAILED_RUN
from geoskill.cli.study import read_metrics
from geoskill.io.atomic import write_text

if TYPE_CHECKING:
    import pandas as pd

KINDS = ("kernel", "descriptor", "model", "task", "task.path")


@final
class SweepSummary(Callback):
    """Callback that writes ``summary.md``, ``.csv``, ``.json`` and ``.png`` into the sweep's folder.

    It does so whenever a run ends, wherever that is, for the runs that are complete by then.
    """

    def on_job_end(self, config: DictConfig, job_return: JobReturn, **kwargs: Any) -> None:
        """Summarize the runs of a sweep that are complete, this one among them."""
        if config.hydra.mode == RunMode.MULTIRUN:
            folder = Path(config.hydra.sweep.dir)
            runs, swept = read_runs(folder)
            if len(runs):
                write_summary(runs, swept, folder)

    def on_multirun_end(self, config: DictConfig, **kwargs: Any) -> None:
        """Summarize the runs that are complete, then exit with the status of the first one that failed, if any."""
        folder = Path(config.hydra.sweep.dir)
        runs, swept = read_runs(folder)
        if len(runs):
            write_summary(runs, swept, folder)
            print((folder / "summary.md").read_text(encoding="utf-8"))
        print(folder.resolve(), flush=True)
        exit_on_failure((str(path.parent), path.parent) for path in _in_job_order(folder, FAILED_RUN))


def read_runs(folder: Path) -> tuple[pd.DataFrame, list[str]]:
    """Read all complete runs of a sweep.

    Overrides that are the same in all runs are left out, and so is ``seed``, over which a summary averages. A run whose
    files are damaged is left out with a warning.

    Returns:
        One row per run, in the order of its jobs: the swept overrides as text, and the metrics; the former's names.
    """
    import pandas as pd

    overrides, metrics = [], []
    for path in _in_job_order(folder, "metrics.json"):
        if path.with_name(FAILED_RUN).exists():  # these are metrics of an earlier run in the same folder
            continue
        try:
            lines = yaml.safe_load((path.parent / ".hydra" / "overrides.yaml").read_text(encoding="utf-8"))
            settings = {key: value for key, _, value in (line.partition("=") for line in lines)}
            own = read_metrics(path)
        except (OSError, ValueError, TypeError, AttributeError, yaml.YAMLError) as error:
            message = " ".join(str(error).split())
            print(f"warning: {path.parent}: left out, its results cannot be read ({message})", file=sys.stderr)
            continue
        overrides.append(settings)
        metrics.append(own)
    table = pd.DataFrame(overrides)
    swept = [key for key in table if key != "seed" and table[key].nunique(dropna=False) > 1]
    return pd.concat([table[swept], pd.DataFrame(metrics)], axis="columns"), swept


def write_summary(runs: pd.DataFrame, by: Sequence[str], folder: Path) -> None:
    """Write means and standard deviations over the seeds as Markdown, CSV, JSON and a plot.

    Args:
        runs: one row per training; see :func:`geoskill.evaluation.tables.summarize`.
        by: the columns that tell settings apart.
        folder: an existing one.
    """
    from geoskill.evaluation.tables import TRAINING_METRICS, summarize, summary_table
    from geoskill.viz.bars import plot_summary

    summary = summarize(runs, by)
    rows = summary.astype(object).where(summary.notna(), None).to_dict("records")
    write_text(folder / "summary.json", json.dumps(rows, indent=2))
    write_text(folder / "summary.csv", summary.to_csv(index=False))
    write_text(folder / "summary.md", summary_table(summary))
    metrics = [name for name in TRAINING_METRICS if name in summary and name != "steps"]
    # Of another kernel, descriptor or objective, the objective is another quantity.
    if any(key in KINDS or key.startswith("objective.") for key in by):
        metrics = [name for name in metrics if name != "objective"]
    if metrics:
        plot_summary(summary, by, metrics, folder / "summary.png")


def exit_on_failure(runs: Iterable[tuple[str, Path]]) -> None:
    """Tell how many runs have failed and why the first one did, and exit with its status; return when none has.

    Args:
        runs: names and folders, in the order of the jobs.
    """
    failures = [(name, folder / FAILED_RUN) for name, folder in runs if (folder / FAILED_RUN).exists()]
    if failures:
        name, path = failures[0]
        status, _, message = path.read_text(encoding="utf-8").strip().partition(" ")
        print(f"error: {len(failures)} run(s) failed, first {name}: {message}", file=sys.stderr)
        sys.exit(int(status))


def job_folders(folder: Path) -> list[Path]:
    """Return the folders of all jobs of a sweep that have begun, in the order of the jobs."""
    return [path.parent for path in _in_job_order(folder, ".hydra")]


def _in_job_order(folder: Path, name: str) -> list[Path]:
    """Return this file of all jobs that have it, the tenth job after the ninth."""
    return sorted(folder.glob(f"*/{name}"), key=lambda path: (len(path.parent.name), path.parent.name))
