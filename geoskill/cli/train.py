"""``python train.py``: learn a skill from a demonstration, or from several."""

import os
import shlex
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from geoskill.cli.command import INTERRUPTED, Run, program, run_command
from geoskill.cli.schemas import SimulatedTaskConfig, TrainCommandConfig
from geoskill.errors import InputError

if TYPE_CHECKING:
    from lightning.pytorch.loggers import Logger, WandbLogger

    from geoskill.cli.sequences import LabeledSequence
    from geoskill.io.frames import FrameSource
    from geoskill.training.learn import LearnedSkill


def main() -> None:
    """Run ``train.py`` or ``geoskill-train``."""
    run_command("train", TrainCommandConfig, train)


def train(config: TrainCommandConfig, run: Run) -> None:
    """Learn, then show on the demonstration what was learned.

    Raises:
        InputError: for whatever the configuration or the demonstration has wrong.
    """
    if not isinstance(config.task, SimulatedTaskConfig) and config.task.path in (None, []):
        raise InputError(
            "task.path is not set; expected a demonstration: python train.py task=video task.path=DIR_OR_FILE"
            " (a folder of images or a video file), or several, task.path=[a.mp4,b.mp4]"
        )
    if run.is_multirun and config.trainer.devices > 1:
        raise InputError(
            f"trainer.devices={config.trainer.devices} in a sweep; expected one process for each of its runs"
            " (trainer=cpu or trainer=gpu)"
        )
    # Heavy imports wait until the configuration is known to be good, so that --help and typos answer at once.
    from geoskill.cli.inputs import open_disk_cache, rerun_of, use_threads
    from geoskill.cli.parts import parts_of
    from geoskill.cli.progress import LINES, is_terminal, show_progress
    from geoskill.cli.report import report_training
    from geoskill.cli.sequences import labeled_demonstrations
    from geoskill.features.cache import FeatureCache
    from geoskill.io.arrays import FramesInMemory
    from geoskill.io.kept_frames import KeptFrames
    from geoskill.skill.checkpoint import CHECKPOINT, SimulatedScene
    from geoskill.training.learn import TrainingInterruptedError, learn

    use_threads(config.threads)
    rerun_of(config.rerun)
    store = open_disk_cache(config.cache)
    simulated = isinstance(config.task, SimulatedTaskConfig)
    first: list[LabeledSequence] = []

    def as_source(sequence: "LabeledSequence") -> "FrameSource":
        first.extend([] if first else [sequence])  # it is shown and scored; of the others no picture is kept
        if isinstance(sequence.frames, KeptFrames):
            return sequence.frames
        return FramesInMemory(sequence.frames, sequence.source.frame_rate, sequence.source.name)

    loggers = _loggers(config, run)
    resume, init_from = _beginning(config, run.folder / CHECKPOINT)
    try:
        learned = learn(
            config.learning(),
            map(as_source, labeled_demonstrations(config, store)),
            checkpoint=run.folder / CHECKPOINT,
            resume=resume,
            init_from=init_from,
            curves=run.folder / "metrics.csv",
            logger=loggers,
            cache=None if store is None else FeatureCache(store),
            progress=show_progress,
            report=None if is_terminal() else LINES.enter,
            scene=SimulatedScene(config.task.name, config.seed, config.scenario) if simulated else None,
            count=config.task.num_demonstrations if simulated else len(parts_of(config.task)),
        )
    except TrainingInterruptedError as interruption:
        _say_how_to_go_on(run, run.folder / CHECKPOINT, interruption.epochs)
        sys.exit(INTERRUPTED)
    if learned.is_main:
        summary = _write_results(config, run, learned, first[0])
        _log_results(loggers, run, summary)
        if config.report:
            report_training(run, learned.skill, config.task.name if simulated else None)
        _print_summary(config, run, learned, summary)


def _beginning(config: TrainCommandConfig, own: Path) -> "tuple[str | None, str | None]":
    """Return the checkpoint to go on with, and the skill whose weights to start from.

    With ``ckpt_path=auto``, and in a job that Slurm has started again, the run's own checkpoint comes before whatever
    the run once began with.
    """
    has_restarted = os.environ.get("SLURM_RESTART_COUNT", "0") != "0"
    if (config.ckpt_path == "auto" or has_restarted) and own.is_file():
        return str(own), None
    return None if config.ckpt_path == "auto" else config.ckpt_path, config.init_from


def _statements(learned: "LearnedSkill") -> list[str]:
    """Return what the demonstration says of each member, their order, and what helps where nothing was learned."""
    from geoskill.skill.phases import timeline

    evidence = learned.skill.evidence
    choice = learned.skill.provenance.choice
    lines = [] if choice is None else choice.statements()
    lines += [f"{name}: {own}" for name, own in evidence.items()]
    phases = learned.skill.phases
    if len(phases) > 1:
        lines += timeline(phases)
    if evidence and not any(own.found for own in evidence.values()):
        lines.append(
            "Its confidence is low everywhere. What helps: a camera at rest, the thing on the table in the first and in"
            " the last pictures, no hand in them, and a thing and a target with some texture."
        )
    return lines


def _print_summary(config: TrainCommandConfig, run: Run, learned: "LearnedSkill", metrics: dict[str, Any]) -> None:
    from geoskill.cli.summary import accuracy_line, confidence_line, decidability_line, print_summary, script

    lines = confidence_line(metrics), accuracy_line(metrics), decidability_line(metrics)
    known = [line for line in lines if line is not None]
    skill = f"skill={run.folder}"
    simulated = isinstance(config.task, SimulatedTaskConfig)
    test = [f"task={config.task.name}", "scenario=robot"] if simulated else ["video=VIDEO", "regions=LABELS"]
    following = [
        f"{script('infer', skill, 'video=VIDEO')}   # on another recording",
        f"{script('evaluate', skill, *test)}   # how often it is right",
    ]
    print_summary([*_statements(learned), *known], run.folder, following)


def _say_how_to_go_on(run: Run, checkpoint: Path, epochs: int) -> None:
    overrides = [override for override in run.overrides if not override.startswith(("ckpt_path=", "init_from="))]
    print(
        f"\ninterrupted after {epochs} epochs, which are in {checkpoint}. To go on:\n"
        f"  {shlex.join([*program(), *overrides, f'ckpt_path={checkpoint}'])}",
        file=sys.stderr,
    )


def _write_results(
    config: TrainCommandConfig, run: Run, learned: "LearnedSkill", sequence: "LabeledSequence"
) -> dict[str, Any]:
    from geoskill.cli.inputs import rerun_of, selection, use_threads
    from geoskill.cli.reporting import chosen, write_inference
    from geoskill.cli.scoring import score
    from geoskill.config import SelectionConfig
    from geoskill.training.quiet import quiet_libraries
    from geoskill.viz.curves import plot_training

    plot_training(run.folder / "metrics.csv", run.folder / "training.png")
    evidence = learned.skill.evidence
    metrics: dict[str, Any] = {
        **learned.metrics,
        "found": any(own.found for own in evidence.values()),
        "evidence": {name: own.as_plain() for name, own in evidence.items()},
        "phases": [phase.as_plain() for phase in learned.skill.phases],
        **chosen(learned.skill),
    }
    with quiet_libraries():
        if sequence.labels is not None:
            # Accuracy is that of a choice in every frame, as in the paper and in evaluate.py.
            always = SelectionConfig(temporal=config.inference.temporal, filter=config.inference.filter, abstain=0.0)
            scores, _ = score(learned.skill, sequence.frames, sequence.labels, config.task.every, always)
            scores["evaluated_frames"] = scores["frames"]
            # Metrics of training and of all frames keep their meaning, labeled or not.
            metrics = {name: value for name, value in scores.items() if isinstance(value, int | float)} | metrics
        return write_inference(
            learned.skill,
            selection(learned.skill, config.inference),
            sequence.frames,
            sequence.source,
            run.folder,
            config.inference.min_drawn_weight,
            metrics,
            use_threads(config.threads),
            rerun_of(config.rerun),
        )


def _loggers(config: TrainCommandConfig, run: Run) -> "list[Logger]":
    if not config.logger:
        return []
    from lightning.pytorch.loggers import WandbLogger

    os.environ.setdefault("WANDB_SILENT", "true")
    settings = config.logger["wandb"]
    logger = WandbLogger(
        project=settings.project, entity=settings.entity, offline=settings.offline, save_dir=str(run.folder)
    )
    logger._wandb_init.pop("anonymous", None)  # Lightning always gives it, and wandb then warns
    return [logger]


def _log_results(loggers: "Sequence[Logger | WandbLogger]", run: Run, summary: dict[str, Any]) -> None:
    """Give wandb the metrics, the pictures and the checkpoint, as an artifact that ``skill=wandb:…`` fetches."""
    for logger in loggers:
        import wandb

        from geoskill.skill.checkpoint import CHECKPOINT

        experiment = logger.experiment  # type: ignore[union-attr]  # the only logger there is
        experiment.summary.update(summary)
        experiment.log(
            {
                "overlay": wandb.Video(str(run.folder / "overlay.mp4"), format="mp4"),
                "training": wandb.Image(str(run.folder / "training.png")),
            }
        )
        artifact = wandb.Artifact(f"skill-{experiment.id}", type="skill")
        artifact.add_file(str(run.folder / CHECKPOINT))
        experiment.log_artifact(artifact)
        wandb.finish()


if __name__ == "__main__":
    main()
