"""Fixtures: an untrained skill."""

from pathlib import Path
from typing import Any

import pytest
import torch

from geoskill.skill.spec import build


@pytest.fixture(scope="session")
def checkpoint(description: dict[str, Any]) -> dict[str, Any]:
    """Return the part of a training run's checkpoint that a skill needs."""
    members = build(description, seed=3).members
    for member in members.values():
        member.set_reward_scale(torch.tensor([2, 4]), torch.tensor([0.5, 0.25]))
    weights = {f"members.{name}.{key}": w for name, m in members.items() for key, w in m.state_dict().items()}
    return {"skill": description, "state_dict": weights, "epoch": 3}


@pytest.fixture
def skill_file(tmp_path: Path, checkpoint: dict[str, Any]) -> Path:
    path = tmp_path / "skill.ckpt"
    torch.save(checkpoint, path)
    return path
