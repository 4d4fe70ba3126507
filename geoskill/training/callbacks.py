"""What Lightning does besides training: the table of curves, and a checkpoint that is always there to resume from."""

import csv
import os
from pathlib import Path
from typing import Any, final

from lightning import Callback, LightningModule, Trainer
from lightning.pytorch.callbacks import Checkpoint

from geoskill.io.atomic import atomic_open


@final
class MetricsTable(Callback):
    """The curves as ``metrics.csv``, one row a step; whole again after a resumed training, since it is in checkpoints.

    Args:
        path: the file; replaced at the end of every epoch.
    """

    def __init__(self, path: Path) -> None:
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
        if not trainer.is_global_zero or not self.rows:
            return
        with atomic_open(self.path, newline="") as file:
            writer = csv.DictWriter(file, fieldnames=list(self.rows[0]))
            writer.writeheader()
            writer.writerows(self.rows)

    def state_dict(self) -> dict[str, Any]:
        """The rows so far."""
        return {"rows": self.rows}

    def load_state_dict(self, state_dict: dict[str, Any]) -> None:
        """Go on after the rows of an earlier run."""
        self.rows = list(state_dict["rows"])


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
        temporary = self.path.with_suffix(".ckpt.part")
        try:
            trainer.save_checkpoint(temporary)
            if trainer.is_global_zero:
                os.replace(temporary, self.path)
        finally:
            if trainer.is_global_zero:
                temporary.unlink(missing_ok=True)

    def on_train_start(self, trainer: Trainer, pl_module: LightningModule) -> None:
        """Something to resume from, even if the first epoch is interrupted."""
        self._save(trainer)

    def on_train_epoch_end(self, trainer: Trainer, pl_module: LightningModule) -> None:
        """Replace the checkpoint."""
        self._save(trainer)
