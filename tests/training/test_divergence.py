"""A training that diverges ends at once, says why, and overwrites nothing."""

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any, final

import numpy as np
import pytest
import torch
from lightning import Callback, LightningModule, Trainer

from geoskill.config import OptimizerConfig, TrainConfig
from geoskill.errors import InputError
from geoskill.skill.checkpoint import read_skill
from geoskill.skill.skill import Skill
from geoskill.training.divergence import DivergenceGuard

# What the fixtures of conftest.py make; see there.
Training = Any
Learn = Any
Configured = Callable[..., TrainConfig]


@final
class Spoil(Callback):
    """Writes a number over a weight after a step."""

    def __init__(self, step: int, value: float) -> None:
        self.step, self.value = step, value

    def on_train_batch_end(self, trainer: Trainer, pl_module: LightningModule, *args: Any) -> None:
        if trainer.global_step == self.step:
            with torch.no_grad():
                next(pl_module.parameters()).view(-1)[-1] = self.value


@pytest.mark.parametrize("value", [float("nan"), float("inf")])
@pytest.mark.parametrize(("step", "epochs"), [(1, 0), (4, 1), (6, 1)])
def test_training_ends_at_the_first_step_that_is_not_finite(
    training: Training, tmp_path: Path, step: int, epochs: int, value: float
) -> None:
    """Three steps an epoch: the sixth is the last of the second epoch, whose checkpoint is not written."""
    guard, folder = DivergenceGuard(), tmp_path / "run"
    message = (
        rf"^training diverged at step {step}: members\.\S+ is not finite; expected a smaller optimizer\.lr than 0\.003,"
        rf" or a limit in trainer\.gradient_clip_val; the {epochs} epoch\(s\) before it are in the checkpoint$"
    )
    with pytest.raises(InputError, match=message):
        training.run(training.module(), folder, epochs=3, callbacks=[Spoil(step, value), guard])
    assert guard.steps == step - 1
    stored = read_skill(folder)
    assert stored.provenance.epochs[0] == epochs
    assert len((folder / "metrics.csv").read_text().splitlines()) == 4 if epochs else True
    assert [path.name for path in folder.iterdir() if path.name.startswith(".")] == []


def test_learning_rate_that_is_far_too_large(
    learn_unchecked: Learn, configured: Configured, pictures: np.ndarray, tmp_path: Path
) -> None:
    config = configured(optimizer=OptimizerConfig(lr=1e20))
    path = tmp_path / "skill.ckpt"
    message = re.escape(
        "training diverged at step 2: p2p_sift/objective is not finite; expected a smaller optimizer.lr than 1e+20,"
    )
    with pytest.raises(InputError, match=f"^{message}"):
        learn_unchecked(config, pictures, checkpoint=path)
    assert read_skill(path).provenance.epochs == (0, 2)
    with pytest.warns(UserWarning, match="is unfinished"):
        Skill.load(path)  # the network as it was before the first step


def test_margin_that_is_not_finite_is_not_written(training: Training, tmp_path: Path) -> None:
    """Weights may be finite, and the scores that they give not."""
    spoil = Spoil(6, 3e38)
    with pytest.raises(InputError, match=r"reference_margin is not finite; expected the weights of a training that di"):
        training.run(training.module(), tmp_path / "run", epochs=2, callbacks=[spoil, DivergenceGuard()])
    stored = read_skill(tmp_path / "run")
    assert (stored.provenance.epochs[0], stored.provenance.finished) == (1, False)
