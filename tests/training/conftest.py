"""A demonstration of ten frames, and what learns from it within a second."""

import signal
from collections.abc import Callable, Iterator
from typing import Any, Protocol

import jaxtyping
import numpy as np
import pytest
import torch

from geoskill.config import (
    DemonstrationConfig,
    FeaturesConfig,
    InferenceConfig,
    ObjectiveConfig,
    TrainConfig,
    TrainerConfig,
)
from geoskill.skill.skill import Skill
from geoskill.training.learn import LearnedSkill, learn


class Learn(Protocol):
    """:func:`geoskill.learn` without the check of annotated types, which would take most of the time."""

    def __call__(self, config: TrainConfig | None, demonstrations: Any = (), **options: Any) -> LearnedSkill: ...


@pytest.fixture(scope="session")
def pictures(demonstration_frames: tuple[np.ndarray, ...]) -> np.ndarray:
    """Return frames 4 to 13 of the demonstration, ``[10, 120, 160, 3]``: spans of 2 and 4, so 8 + 6 transitions."""
    return np.stack(demonstration_frames[4:14])


@pytest.fixture(scope="session")
def configured() -> Callable[..., TrainConfig]:
    """Return a function that makes a configuration with three steps an epoch and a small bilinear network."""

    def make(epochs: int = 2, demonstration: dict[str, Any] | None = None, **settings: Any) -> TrainConfig:
        defaults: dict[str, Any] = {
            "kernel": "p2p",
            "model": {"name": "bilinear", "hidden_dim": 8},
            "features": FeaturesConfig(max_features=10, min_side=0, color=0.0),
            "demonstration": DemonstrationConfig(**{"batch_size": 4, "num_negatives": 0, **(demonstration or {})}),
            "objective": ObjectiveConfig(top_k=3),
            "trainer": TrainerConfig(max_epochs=epochs, limit_train_batches=3),
            "inference": InferenceConfig(top_k=4),
            "threads": 1,
        }
        return TrainConfig(**{**defaults, **settings})

    return make


@pytest.fixture(scope="session")
def learn_unchecked() -> Learn:
    def run(config: TrainConfig | None, demonstrations: Any = (), **options: Any) -> LearnedSkill:
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(jaxtyping.config, "jaxtyping_disable", True)
            return learn(config, demonstrations, **options)

    return run


@pytest.fixture(scope="session")
def state_of() -> Callable[[Skill], dict[str, torch.Tensor]]:
    """Return a function that gives weights and fitted statistics of a skill by their names in a checkpoint."""

    def state(skill: Skill) -> dict[str, torch.Tensor]:
        return torch.nn.ModuleDict(dict(skill.members)).state_dict(prefix="members.")

    return state


@pytest.fixture
def interrupts() -> Iterator[None]:
    """Restore Ctrl-C, which Lightning switches off when it is interrupted."""
    handler = signal.getsignal(signal.SIGINT)
    yield
    signal.signal(signal.SIGINT, handler)
