"""The end of a training that has diverged, before anything good is overwritten."""

from typing import Any, final

import torch
from lightning import Callback, LightningModule, Trainer

from geoskill.errors import InputError


@final
class DivergenceGuard(Callback):
    """Ends a training at the first step after which an objective or a weight is not finite.

    No checkpoint of that epoch is written, so the one of the last finite epoch stays. It comes before callbacks that
    take anything from a step.

    Attributes:
        steps: finite ones, in this process.
    """

    def __init__(self) -> None:
        self.steps = 0

    def on_train_batch_end(
        self, trainer: Trainer, pl_module: LightningModule, outputs: Any, batch: Any, batch_idx: int
    ) -> None:
        """Look at what the step logged and left.

        Raises:
            InputError: when it is not finite; the message names step, quantity and likely cause.
        """
        objectives = {name: value for name, value in trainer.logged_metrics.items() if name.endswith("/objective")}
        # Objectives are means over all processes, and weights the same in all of them, so all end at the same step.
        for name, value in (*objectives.items(), *pl_module.named_parameters()):
            if not torch.isfinite(torch.as_tensor(value)).all():
                rate = trainer.optimizers[0].param_groups[0]["lr"]
                kept = f"; the {trainer.current_epoch} epoch(s) before it are in the checkpoint"
                raise InputError(
                    f"training diverged at step {trainer.global_step}: {name} is not finite; expected a smaller"
                    f" optimizer.lr than {rate:g}, or a limit in trainer.gradient_clip_val"
                    f"{kept if trainer.checkpoint_callbacks else ''}"
                )
        self.steps += 1
