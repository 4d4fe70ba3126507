"""``python train.py``: learn a skill from a demonstration, or from several."""

from __future__ import annotations

import contextlib
import shlex
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hydra.core.hydra_config import HydraConfig
from hydra.types import RunMode
from hydra.utils import instantiate
from omegaconf import DictConfig, ListConfig, OmegaConf

from geoskill.cli.command import INTERRUPTED, run_command
from geoskill.cli.settings import refusing
from geoskill.errors import InputError

if TYPE_CHECKING:
    from lightning import Trainer

CHECKPOINT = "skill.ckpt"


def main() -> None:
    """Entry point of ``train.py`` and ``geoskill-train``."""
    run_command("train", train)


def train(cfg: DictConfig) -> None:
    """Learn, then show on the demonstration what was learned.

    Raises:
        InputError: for whatever the configuration or the demonstration has wrong.
    """
    simulated = "scene" in cfg.task
    path = cfg.task.get("path")
    count = cfg.task.takes if simulated else len(path) if isinstance(path, ListConfig) else int(path is not None)
    if not simulated and count == 0:
        raise InputError(
            "task.path is not set; expected a demonstration: python train.py task=video task.path=DIR_OR_FILE"
            " (a folder of images or a video file), or several, task.path=[a.mp4,b.mp4]"
        )
    _check_ranges(cfg)
    # Heavy imports wait until the configuration is known to be good, so that --help and typos answer at once.
    from geoskill.cli.footage import demonstrations
    from geoskill.cli.inputs import array_store, require_selection, selection, use_threads
    from geoskill.cli.progress import quiet_libraries, show_progress
    from geoskill.cli.reporting import write_inference
    from geoskill.cli.resuming import require_same_skill, require_same_spans
    from geoskill.cli.scoring import score
    from geoskill.data.datamodule import TransitionData
    from geoskill.data.demonstration import Demonstration
    from geoskill.data.demonstrations import Demonstrations
    from geoskill.features.cache import FeatureCache
    from geoskill.skill.skill import Skill, read_checkpoint
    from geoskill.skill.spec import build, describe
    from geoskill.training.calibration import fit_reference_margin
    from geoskill.training.callbacks import MetricsTable
    from geoskill.training.error_changes import fit_reward_scale
    from geoskill.training.module import SkillTraining
    from geoskill.training.node_order import fit_node_order
    from geoskill.viz.curves import plot_training

    quiet_libraries()
    require_selection(cfg.inference)
    threads = use_threads(cfg.threads)
    folder = Path(HydraConfig.get().runtime.output_dir)
    plain: dict[str, Any] = OmegaConf.to_container(cfg, resolve=True)  # type: ignore[assignment]
    description = describe(
        plain["kernel"], plain["descriptor"], plain["model"], plain["features"], cfg.inference.alternatives
    )
    if simulated:  # the seed by which other recordings show the same things
        choices = HydraConfig.get().runtime.choices
        scenario = {key: value for key, value in plain["scenario"].items() if key != "_target_"}
        description["learned_from"] = {"task": choices["task"], "seed": cfg.seed, "scenario": scenario}
    description["demonstrations"] = count
    stored = None if cfg.ckpt_path is None else read_checkpoint(str(cfg.ckpt_path))
    if stored is not None:
        require_same_skill(cfg, stored, description)

    store = array_store(cfg)
    cache = None if store is None else FeatureCache(store)
    objective = instantiate(cfg.objective)
    with refusing("model"):
        parts = build(description, cache, cfg.seed)
    loggers = [instantiate(logger, save_dir=str(folder)) for logger in cfg.logger.values()]
    for logger in loggers:
        getattr(logger, "_wandb_init", {}).pop("anonymous", None)  # Lightning always gives it, and wandb then warns
    _check_gpu(cfg)
    trainer: Trainer = instantiate(
        cfg.trainer,
        logger=loggers or False,
        callbacks=[MetricsTable(folder / "metrics.csv"), *_callbacks(cfg, folder)],
        default_root_dir=str(folder),
        # Elsewhere it shows nothing before the end, and leaves control characters.
        enable_progress_bar=cfg.trainer.enable_progress_bar and sys.stdout.isatty(),
    )
    module = SkillTraining(
        parts.members,
        objective,
        instantiate(cfg.optimizer),
        descriptor_noise=cfg.demonstration.descriptor_noise,
        feature_dropout=cfg.demonstration.feature_dropout,
        max_visible_features=cfg.demonstration.max_visible_features,
        seed=cfg.seed,
        description=description,
    )
    with refusing("optimizer"):
        module.configure_optimizers()  # Lightning does it again, but only when all features are extracted

    footage, followed = None, []
    for recording in demonstrations(cfg, store):
        followed.append(
            Demonstration(
                [frame.image for frame in recording.frames],
                parts.pipelines,
                parts.members,
                gap=cfg.demonstration.gap,
                max_span_ratio=cfg.demonstration.horizon,
                num_negatives=cfg.demonstration.num_negatives,
                progress=show_progress,
                name=recording.source.name,
                threads=threads,
            )
        )
        footage = footage or recording  # the first is shown and scored; of the others no picture is kept
    assert footage is not None
    demonstration = Demonstrations(followed)
    if stored is not None:
        require_same_spans(cfg, stored, demonstration.spans)
    for name, member in parts.members.items():
        member.scorer.fit_prototypes(demonstration.descriptors(name))
    fit_reward_scale(parts.members, demonstration, objective)
    fit_node_order(parts.members, demonstration, objective, cfg.demonstration.descriptor_noise)
    data = TransitionData(demonstration, batch_size=cfg.demonstration.batch_size, seed=cfg.seed)
    _check_processes(trainer)
    for logger in trainer.loggers:
        logger.log_hyperparams(plain)
    _fit(trainer, module, data, cfg.ckpt_path and str(cfg.ckpt_path), folder)
    if not trainer.is_global_zero:
        return

    fit_reference_margin(parts.members, demonstration)  # of the averaged weights, which the members have now
    _complete(folder / CHECKPOINT, parts.members)
    plot_training(folder / "metrics.csv", folder / "training.png")
    skill = Skill(parts)
    metrics = {name: float(value) for name, value in trainer.callback_metrics.items() if not name.endswith("_step")}
    metrics["steps"] = float(trainer.global_step)
    if footage.labels is not None:
        # Accuracy is that of a choice in every frame, as in the paper and in evaluate.py.
        always = DictConfig({**cfg.inference, "abstain": 0.0})
        figures, _ = score(skill, footage.frames, footage.labels, cfg.task.every, always)
        figures["judged_frames"] = figures["frames"]
        # Figures of training and of all frames keep their meaning, labeled or not.
        metrics = {name: value for name, value in figures.items() if isinstance(value, int | float)} | metrics
    infer = selection(skill, cfg.inference)
    summary = write_inference(
        skill, infer, footage.frames, footage.source, folder, cfg.inference.minimum_weight, metrics, threads
    )
    _log_results(trainer, folder, summary)
    print(folder)


def _check_ranges(cfg: DictConfig) -> None:
    """What no object checks when it is built."""
    for key, lowest, expected in (
        ("task.every", 1, "at least 1"),
        ("task.takes", 1, "at least 1"),
        ("demonstration.descriptor_noise", 0, "0 or more"),
        ("demonstration.num_negatives", 0, "0 or more"),
        ("demonstration.max_visible_features", 2, "at least 2, or null"),
        ("early_stopping.patience", 0, "0 or more, or null"),
    ):
        value = OmegaConf.select(cfg, key)
        if value is not None and value < lowest:
            raise InputError(f"{key}={value}: expected {expected}")
    for key in ("demonstration.feature_dropout", "ema_decay"):
        value = OmegaConf.select(cfg, key)
        if value is not None and not 0 <= value < 1:
            raise InputError(f"{key}={value}: expected 0 or more, below 1")
    for key in ("max_epochs", "limit_train_batches"):
        if cfg.trainer.get(key) == 0:
            raise InputError(f"trainer.{key}=0: expected at least 1")


def _check_gpu(cfg: DictConfig) -> None:
    from lightning.pytorch.accelerators import CUDAAccelerator, MPSAccelerator

    if cfg.trainer.accelerator == "gpu" and not (CUDAAccelerator.is_available() or MPSAccelerator.is_available()):
        raise InputError("trainer.accelerator=gpu: PyTorch finds no GPU here; expected trainer=cpu")


def _callbacks(cfg: DictConfig, folder: Path) -> list[Any]:
    from lightning.pytorch.callbacks import EarlyStopping, EMAWeightAveraging

    from geoskill.training.callbacks import ResumableCheckpoint

    callbacks: list[Any] = [ResumableCheckpoint(folder / CHECKPOINT)]
    if cfg.ema_decay is not None:
        # Buffers are fitted statistics, which have no average.
        callbacks.append(EMAWeightAveraging(decay=cfg.ema_decay, use_buffers=False))
    if cfg.early_stopping.patience is not None:
        callbacks.append(
            EarlyStopping(
                "objective_epoch",
                mode="max",
                patience=cfg.early_stopping.patience,
                min_delta=cfg.early_stopping.min_delta,
            )
        )
    return callbacks


def _fit(trainer: Trainer, module: Any, data: Any, checkpoint: str | None, folder: Path) -> None:
    """Train; when interrupted, say how to go on. Lightning turns Ctrl-C into the end of the program."""
    try:
        trainer.fit(module, datamodule=data, ckpt_path=checkpoint, weights_only=True)
    except (SystemExit, KeyboardInterrupt):
        if trainer.interrupted and trainer.is_global_zero:
            overrides = [o for o in HydraConfig.get().overrides.task if not o.startswith("ckpt_path=")]
            print(
                f"\ninterrupted after {trainer.current_epoch} epochs; {folder / CHECKPOINT} is complete. To go on:\n"
                f"  python train.py {shlex.join([*overrides, f'ckpt_path={folder / CHECKPOINT}'])}",
                file=sys.stderr,
            )
            with contextlib.suppress(ValueError):
                sys.stdout.flush()
            sys.exit(INTERRUPTED)
        raise


def _complete(path: Path, members: Mapping[str, Any]) -> None:
    """Add to a checkpoint what could be fitted only after the training."""
    import torch

    from geoskill.io.atomic import atomic_open
    from geoskill.skill.skill import read_checkpoint

    checkpoint = read_checkpoint(path)
    for name, member in members.items():
        checkpoint["state_dict"][f"members.{name}.reference_margin"] = member.reference_margin
    with atomic_open(path, "wb") as file:
        torch.save(checkpoint, file)


def _check_processes(trainer: Trainer) -> None:
    """Lightning starts further processes by repeating the command line, which in a sweep would repeat the sweep."""
    environment = getattr(trainer.strategy, "cluster_environment", None)
    started_here = environment is not None and not environment.creates_processes_externally
    if HydraConfig.get().mode == RunMode.MULTIRUN and trainer.world_size > 1 and started_here:
        raise InputError(
            f"trainer.devices={trainer.num_devices} in a sweep; expected one process for each of its runs (trainer=cpu"
            " or trainer=gpu)"
        )


def _log_results(trainer: Trainer, folder: Path, summary: dict[str, Any]) -> None:
    from lightning.pytorch.loggers import WandbLogger

    for logger in trainer.loggers:
        if isinstance(logger, WandbLogger):
            import wandb

            run = logger.experiment
            run.summary.update(summary)
            run.log(
                {
                    "overlay": wandb.Video(str(folder / "overlay.mp4"), format="mp4"),
                    "training": wandb.Image(str(folder / "training.png")),
                }
            )
            wandb.finish()


if __name__ == "__main__":
    main()
