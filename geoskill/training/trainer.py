"""The Lightning trainer and the optimizer of a configuration."""

import os
import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import torch
from lightning import Callback, Trainer
from lightning.fabric.plugins.environments.lightning import LightningEnvironment
from lightning.fabric.plugins.environments.slurm import SLURMEnvironment
from lightning.pytorch.accelerators import CUDAAccelerator, MPSAccelerator
from lightning.pytorch.callbacks import EarlyStopping, EMAWeightAveraging

from geoskill.config import OptimizerConfig, TrainConfig, TrainerConfig
from geoskill.errors import InputError
from geoskill.schema import as_plain
from geoskill.training.callbacks import EpochLines, MetricsTable, ResumableCheckpoint, SkillRecord
from geoskill.training.divergence import DivergenceGuard

if TYPE_CHECKING:
    from lightning.pytorch.loggers import Logger

OPTIMIZERS = {"adam": torch.optim.Adam, "adamw": torch.optim.AdamW, "sgd": torch.optim.SGD}


def build_optimizer(config: OptimizerConfig) -> Callable[[Iterable[torch.nn.Parameter]], torch.optim.Optimizer]:
    """Return what makes the optimizer from parameters."""
    return partial(OPTIMIZERS[config.name], lr=config.lr, weight_decay=config.weight_decay)


def build_trainer(
    config: TrainConfig,
    guard: DivergenceGuard,
    table: MetricsTable,
    record: SkillRecord,
    checkpoint: Path | None,
    loggers: "Sequence[Logger]",
    *,
    progress_bar: bool,
    report: Callable[[str], None] | None = None,
) -> Trainer:
    """Return the trainer with its callbacks, in the order in which they depend on each other.

    Args:
        config: of the training.
        guard: ends a training that diverges.
        table: keeps the curves.
        record: completes checkpoints; it is called after the averaging of weights.
        checkpoint: file of the checkpoint, or None.
        loggers: Lightning's.
        progress_bar: whether to show one, where there is a terminal.
        report: takes a line after every epoch, or None.
    """
    callbacks: list[Callback] = [guard, table]
    if config.ema_decay is not None:
        # Buffers are fitted statistics, which have no average.
        callbacks.append(EMAWeightAveraging(decay=config.ema_decay, use_buffers=False))
    if config.early_stopping.patience is not None:
        callbacks.append(EarlyStopping("objective_epoch", mode="max", **as_plain(config.early_stopping)))
    callbacks.append(record)
    if report is not None:
        callbacks.append(EpochLines(report))
    if checkpoint is not None:
        callbacks.append(ResumableCheckpoint(checkpoint))
    settings = as_plain(config.trainer)
    # Elsewhere than on a terminal a bar shows nothing before the end, and leaves control characters.
    settings["enable_progress_bar"] &= progress_bar and sys.stdout.isatty()
    return Trainer(
        **settings,
        logger=list(loggers) or False,
        plugins=cluster_environment(),
        callbacks=callbacks,
        default_root_dir=None if checkpoint is None else str(checkpoint.parent),
        enable_checkpointing=checkpoint is not None,
        enable_model_summary=False,
    )


def cluster_environment() -> SLURMEnvironment | LightningEnvironment | None:
    """Return what starts the processes of a training inside a job of Slurm; elsewhere None, and Lightning finds out.

    Lightning would requeue the job by itself with a checkpoint from the middle of an epoch, with which a training does
    not go on exactly as it would have; ours of the last epoch does, and Slurm requeues a preempted job anyway.
    """
    if os.environ.get("SLURM_NTASKS", "1") != "1":  # srun has started one process for each device
        return SLURMEnvironment(auto_requeue=False)
    return LightningEnvironment() if "SLURM_JOB_ID" in os.environ else None


@contextmanager
def use_threads(threads: int | None) -> Iterator[None]:
    """Let PyTorch take so many threads while the block runs; None for as many as it likes."""
    before = torch.get_num_threads()
    if threads is not None:
        torch.set_num_threads(threads)
    try:
        yield
    finally:
        torch.set_num_threads(before)


def require_usable(config: TrainerConfig) -> None:
    """Refuse what Lightning cannot train with here, before any work is done.

    Raises:
        InputError: when there is no such device, or Lightning refuses a value.
    """
    if config.accelerator == "gpu" and not (CUDAAccelerator.is_available() or MPSAccelerator.is_available()):
        raise InputError("accelerator=gpu: PyTorch finds no GPU here; expected cpu (trainer=cpu)")
    try:
        Trainer(
            **as_plain(config),
            logger=False,
            plugins=cluster_environment(),
            enable_checkpointing=False,
            enable_model_summary=False,
        )
    except (TypeError, ValueError, RuntimeError) as error:
        raise InputError(f"trainer: {error}") from error
