"""Going on with a hostile training: nothing in it is called, imported or opened, wherever in the checkpoint it is."""

import contextlib
import copy
import random
import sys
from pathlib import Path
from typing import Any

import jaxtyping
import numpy as np
import pytest
import torch

from geoskill.config import DemonstrationConfig, FeaturesConfig, TrainConfig, TrainerConfig
from geoskill.errors import InputError
from geoskill.training.learn import learn
from tests.cli.test_hostile_checkpoint import attacks, places


def is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def test_going_on_runs_nothing(
    demonstration_frames: tuple[np.ndarray, ...], rounds: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """At places that this package reads, and at those that Lightning does; every tenth of the usual number."""
    monkeypatch.setattr(jaxtyping.config, "jaxtyping_disable", True)
    monkeypatch.syspath_prepend(tmp_path)
    flag, path, chance = tmp_path / "flag", tmp_path / "skill.ckpt", random.Random(6)
    values = [*attacks(flag), None, "x", b"x", [], {}, [[1]], 2**300, float("nan")]

    def configuration(epochs: int) -> TrainConfig:
        return TrainConfig(
            model={"name": "bilinear", "hidden_dim": 4},
            features=FeaturesConfig(max_features=10, min_side=0, color=0.0),
            demonstration=DemonstrationConfig(max_span_ratio=0, num_negatives=0),
            trainer=TrainerConfig(max_epochs=epochs, limit_train_batches=1),
            threads=1,
        )

    frames = demonstration_frames[4:10]
    learn(configuration(1), frames, checkpoint=path)
    original = torch.load(path, weights_only=True)
    count = len(list(places(original)))
    ends = []
    for _ in range(max(rounds // 10, 10)):
        contents = copy.deepcopy(original)
        container, key, where = list(places(contents))[chance.randrange(count)]
        value = chance.choice(values)
        if is_number(container[key]) and is_number(value):
            continue  # a number of steps without end is no attack on others
        container[key] = value
        torch.save(contents, path)
        with contextlib.suppress(InputError):
            learn(configuration(2), frames, resume=path)
            ends.append(where)
        assert not flag.exists(), (where, value)
        assert "hostile_module" not in sys.modules, (where, value)
    assert len(ends) < rounds
