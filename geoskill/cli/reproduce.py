"""``python reproduce.py``: a table or figure of the paper, or another study of ``conf/artifact``, from one command."""

from __future__ import annotations

import json
import logging
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from hydra._internal.callbacks import Callbacks
from hydra.core.global_hydra import GlobalHydra
from hydra.core.hydra_config import HydraConfig
from hydra.core.plugins import Plugins
from hydra.types import HydraContext, RunMode
from omegaconf import DictConfig

from geoskill.cli.command import FAILED_RUN, Run, current_run, record_failure, run_command
from geoskill.cli.compose import typed
from geoskill.cli.schemas import ReproduceCommandConfig
from geoskill.cli.study import Job, Study
from geoskill.cli.sweep import exit_on_failure, write_summary
from geoskill.io.atomic import write_text

log = logging.getLogger(__name__)

BASELINE = "hand-picked trackers"


def main() -> None:
    """Run ``reproduce.py`` or ``geoskill-reproduce``."""
    run_command("reproduce", ReproduceCommandConfig, reproduce)


def reproduce(config: ReproduceCommandConfig, run: Run) -> None:
    """Train and score what is not complete yet, then write the tables and pictures of what is.

    Jobs go to the launcher of ``hydra/launcher``. One that fails does not stop the others; each that ends writes the
    tables of those that are complete by then. When all have ended, the first failure is reported, and the exit status
    is that of this failure.

    Raises:
        InputError: when the study or its data have something wrong, or the folder holds results of other settings.
    """
    from geoskill.cli.report import report_study

    study, folder, jobs = _open(config, run)
    launch([number for number, job in enumerate(jobs) if not job.is_complete()], config.jobs)
    complete = [job for job in jobs if _has_results(job)]
    if complete:
        write_tables(folder, study, complete)
        if config.report:
            report_study(run, folder)
        print((folder / "table.md").read_text(encoding="utf-8"))
    print(folder, flush=True)
    exit_on_failure([(f"{job.name} ({job.training.folder})", job.training.folder) for job in jobs])


def launch(numbers: Sequence[int], at_once: int) -> None:
    """Hand jobs of the study to Hydra's launcher, which calls :func:`perform_job` with each in a process of its own.

    Args:
        numbers: of the jobs, in the order of :meth:`Study.jobs`.
        at_once: how many the launcher on this machine runs at the same time; others have settings of their own.
    """
    if not numbers:
        return
    hydra, loader = HydraConfig.get(), GlobalHydra.instance().config_loader()
    given = list(hydra.overrides.task)
    local = [f"hydra.launcher.n_jobs={at_once}"] if "n_jobs" in hydra.launcher else []
    own = ["hydra.output_subdir=null", *hydra.overrides.hydra, *local]  # the configuration is stored once
    config = loader.load_configuration(hydra.job.config_name, [*own, *given], RunMode.MULTIRUN)
    launcher = Plugins.instance().instantiate_launcher(HydraContext(loader, Callbacks(config)), perform_job, config)
    for ended in launcher.launch([[*given, f"job={number}"] for number in numbers], initial_job_idx=0):
        _ = ended.return_value  # raises what was not recorded as a failure of the job


def perform_job(cfg: DictConfig) -> None:
    """Perform the job of number ``job``, and gather what is complete; a failure is logged and left in its folder."""
    config = typed(cfg, ReproduceCommandConfig)
    assert config.job is not None
    study, folder, jobs = _open(config, current_run())
    job = jobs[config.job]
    failure = job.training.folder / FAILED_RUN
    failure.parent.mkdir(parents=True, exist_ok=True)
    record_failure(job.perform, "reproduce", failure)
    if failure.exists():
        log.error("%s: failed with status %s", job.name, failure.read_text(encoding="utf-8").strip())
    complete = [own for own in jobs if _has_results(own)]
    if 0 < len(complete) < len(jobs):  # the last one leaves it to whoever waits for all of them
        write_tables(folder, study, complete)


def _has_results(job: Job) -> bool:
    return not (job.training.folder / FAILED_RUN).exists() and job.is_complete()


def write_tables(folder: Path, study: Study, jobs: Sequence[Job]) -> None:
    """Write the tables and pictures of complete jobs into the folder of the study.

    Args:
        folder: an existing one.
        study: has the test sets and published values.
        jobs: at least one.
    """
    from geoskill.evaluation import tables
    from geoskill.viz.bars import plot_bars, plot_reliability, plot_trainings

    scores: dict[str, list[dict[str, Any]]] = {}
    curves: dict[str, list[Path]] = {}
    for job in jobs:
        scores.setdefault(job.variant, []).append(job.scores(tables.TRAINING_METRICS))
        curves.setdefault(job.variant, []).append(job.training.folder / "metrics.csv")
    trainings = tables.training_frame(scores)
    write_summary(trainings, ["variant"], folder)
    test_sets, published, frame = list(study.test_sets), dict(study.published), trainings
    markdown = (folder / "summary.md").read_text(encoding="utf-8")
    if test_sets:
        frame = tables.score_frame(scores, test_sets)
        if study.baseline:
            published = {BASELINE: tables.baseline_success(frame), **published}
        markdown = tables.overview(scores, test_sets, published) + "\n" + tables.details(scores, test_sets)
        plot_bars(test_sets, tables.accuracies(frame, test_sets), published, folder / "accuracy.png")
        bins = {str(variant): tables.reliability_of(rows) for variant, rows in frame.groupby("variant", sort=False)}
        plot_reliability(bins, folder / "reliability.png")
    contents = {"scores": scores, "published": published}
    write_text(folder / "table.md", markdown)
    write_text(folder / "table.csv", tables.csv_table(frame))
    write_text(folder / "table.json", json.dumps(contents, indent=2))
    plot_trainings(curves, folder / "training.png")


def _open(config: ReproduceCommandConfig, run: Run) -> tuple[Study, Path, list[Job]]:
    study = Study.from_plain(config.artifact)
    folder = run.folder / ("quick" if config.quick else "full")
    return study, folder, study.jobs(folder, config.quick)


if __name__ == "__main__":
    main()
