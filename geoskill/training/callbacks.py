"""Lightning callbacks: the table of curves, and a checkpoint to resume from, whose last version is the skill."""

import copy
import csv
import time
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, final

from lightning import Callback, LightningModule, Trainer
from lightning.pytorch.callbacks import Checkpoint
from torch import Tensor, nn

from geoskill.data.transitions import Transitions
from geoskill.features.pipeline import FeaturePipeline
from geoskill.io.atomic import atomic_open, atomic_path
from geoskill.model.kernel_model import KernelModel
from geoskill.skill.checkpoint import Provenance, skill_entry
from geoskill.skill.spec import SkillSpec
from geoskill.skill.weights import require_finite
from geoskill.training.calibration import calibrate, is_calibration, uncalibrated


@final
class MetricsTable(Callback):
    """The curves as rows, one a step; checkpoints hold them, so that a resumed training has all of them.

    Args:
        path: of a CSV file, replaced at the end of every epoch, or None.
    """

    def __init__(self, path: Path | None = None) -> None:
        self.path = path
        self.rows: list[dict[str, float]] = []

    def on_train_batch_end(
        self, trainer: Trainer, pl_module: LightningModule, outputs: Any, batch: Any, batch_idx: int
    ) -> None:
        """Keep what the members logged at this step."""
        logged = {name: float(value) for name, value in trainer.logged_metrics.items() if "/" in name}
        self.rows.append({"step": trainer.global_step, "epoch": trainer.current_epoch, **logged})

    def on_train_epoch_end(self, trainer: Trainer, pl_module: LightningModule) -> None:
        """Write the table."""
        if trainer.is_global_zero:
            self.write()

    def write(self) -> None:
        """Replace the file by the rows so far; without a path or a row there is nothing to write."""
        if self.path is None or not self.rows:
            return
        with atomic_open(self.path, newline="") as file:
            writer = csv.DictWriter(file, fieldnames=list(self.rows[0]))
            writer.writeheader()
            writer.writerows(self.rows)

    def state_dict(self) -> dict[str, Any]:
        """Return the rows so far."""
        return {"rows": self.rows}

    def load_state_dict(self, state_dict: dict[str, Any]) -> None:
        """Take the rows of an earlier run."""
        self.rows = list(state_dict["rows"])


@final
class EpochLines(Callback):
    """A line of text before the first epoch and after every one, with the time that is left.

    Args:
        report: takes the line.
    """

    def __init__(self, report: Callable[[str], None]) -> None:
        self._report = report
        self._began_s = time.monotonic()
        self._first = 0

    def on_train_start(self, trainer: Trainer, pl_module: LightningModule) -> None:
        """Begin to measure, at whatever epoch a training goes on."""
        self._began_s, self._first = time.monotonic(), trainer.current_epoch
        if trainer.is_global_zero and trainer.max_epochs is not None:
            self._report(f"training: {trainer.max_epochs - self._first} epochs")

    def on_train_epoch_end(self, trainer: Trainer, pl_module: LightningModule) -> None:
        """Report."""
        if not trainer.is_global_zero or trainer.max_epochs is None:
            return
        done, total = trainer.current_epoch + 1, trainer.max_epochs
        left_s = (time.monotonic() - self._began_s) / (done - self._first) * (total - done)
        objective = trainer.callback_metrics.get("objective_epoch")
        told = "" if objective is None else f", objective {float(objective):.4g}"
        self._report(f"training: epoch {done} of {total}{told}, {left_s:.0f} s left")


@final
class SkillRecord(Callback):
    """The entry ``skill`` of every checkpoint, and the calibration of the last one.

    In the checkpoint of the last epoch, the members are calibrated with the averaged weights before anything is
    written, and the skill is marked as finished. In all others it is marked as unfinished. So a file is at any moment
    either a complete skill or says that it is none. It comes after a callback that averages weights.

    Args:
        spec: what the skill is made of.
        provenance: where it comes from; epochs and metrics are filled in here.
        pipelines: by name, with the features that they prefer.
        demonstration: to calibrate with.
    """

    def __init__(
        self,
        spec: SkillSpec,
        provenance: Provenance,
        pipelines: Mapping[str, FeaturePipeline],
        demonstration: Transitions,
    ) -> None:
        self.spec = spec
        self.provenance = provenance
        self.pipelines = pipelines
        self.demonstration = demonstration
        self._calibration: dict[str, Tensor] = {}

    def on_train_start(self, trainer: Trainer, pl_module: LightningModule) -> None:
        """Take over the epochs of an earlier run."""
        self._take_in(trainer, trainer.current_epoch)

    def on_train_epoch_end(self, trainer: Trainer, pl_module: LightningModule) -> None:
        """Take in the epoch's metrics. Stopping early is decided later, by another callback."""
        self._take_in(trainer, trainer.current_epoch + 1)

    def on_save_checkpoint(self, trainer: Trainer, pl_module: LightningModule, checkpoint: dict[str, Any]) -> None:
        """Complete what is about to be written.

        Raises:
            InputError: when a weight or a margin is not finite; nothing is written then.
        """
        done, wanted = self.provenance.epochs
        finished = done > 0 and (trainer.should_stop or done >= wanted)
        if finished:
            members = copy.deepcopy(pl_module.members).cpu()
            assert isinstance(members, nn.ModuleDict)
            prefix = "members."
            weights = {key.removeprefix(prefix): weight for key, weight in checkpoint["state_dict"].items()}
            members.load_state_dict(weights)
            calibrate(kernel_models(members), self.demonstration)
            state = members.state_dict(prefix=prefix)
            self._calibration = {key: value for key, value in state.items() if is_calibration(key)}
            checkpoint["state_dict"] = state
        else:  # also when a finished training goes on for more epochs
            assert isinstance(pl_module.members, nn.ModuleDict)
            checkpoint["state_dict"] |= uncalibrated(kernel_models(pl_module.members), prefix="members.")
        require_finite(checkpoint["state_dict"])
        self.provenance = replace(self.provenance, finished=finished)
        checkpoint["skill"] = skill_entry(self.spec, self.provenance, self.pipelines)

    def on_train_end(self, trainer: Trainer, pl_module: LightningModule) -> None:
        """Calibrate the module's own members, whose weights are the averaged ones by now."""
        assert isinstance(pl_module.members, nn.ModuleDict)
        if self._calibration:
            own = {key.removeprefix("members."): value for key, value in self._calibration.items()}
            pl_module.members.load_state_dict(own, strict=False)
        else:  # no checkpoint was wanted
            calibrate(kernel_models(pl_module.members.cpu()), self.demonstration)
        self.provenance = replace(self.provenance, finished=True)

    def _take_in(self, trainer: Trainer, epochs: int) -> None:
        metrics = {name: float(metric) for name, metric in trainer.callback_metrics.items() if "/" not in name}
        metrics = {name: metric for name, metric in metrics.items() if not name.endswith("_step")}
        self.provenance = replace(self.provenance, epochs=(epochs, trainer.max_epochs or 0), metrics=metrics)


@final
class ResumableCheckpoint(Checkpoint):
    """One checkpoint, replaced at the start of training and after every epoch.

    Only between epochs is the state such that a resumed training goes on exactly as it would have; an interrupted
    training therefore loses at most one epoch. The file is replaced when the new one is complete.

    Being a `Checkpoint`, it is called after all other callbacks, whose state it stores.

    Args:
        path: the file.
    """

    def __init__(self, path: Path) -> None:
        self.path = path

    def _save(self, trainer: Trainer) -> None:
        if trainer.is_global_zero:
            with atomic_path(self.path) as temporary:
                trainer.save_checkpoint(temporary)
        else:  # takes part, but writes nothing
            trainer.save_checkpoint(self.path)

    def on_train_start(self, trainer: Trainer, pl_module: LightningModule) -> None:
        """Write something to resume from, even if the first epoch is interrupted."""
        self._save(trainer)

    def on_train_epoch_end(self, trainer: Trainer, pl_module: LightningModule) -> None:
        """Replace the checkpoint."""
        self._save(trainer)


def kernel_models(members: nn.ModuleDict) -> Mapping[str, KernelModel]:
    """Return the members of a skill by name."""
    models = {name: member for name, member in members.items() if isinstance(member, KernelModel)}
    assert len(models) == len(members)
    return models
