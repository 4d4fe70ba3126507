"""Fixtures: an untrained skill."""

from pathlib import Path
from typing import Any

import pytest
import torch

from geoskill.skill.build import build_skill
from geoskill.skill.checkpoint import Provenance, skill_entry
from geoskill.skill.spec import SkillSpec


@pytest.fixture(scope="session")
def provenance() -> Provenance:
    return Provenance(
        sources=("tiles.mp4",),
        image_size=(160, 120),
        date="2026-02-03T04:05:06+00:00",
        version="1.2.3",
        seed=7,
        finished=True,
        epochs=(16, 16),
        metrics={"objective": 0.25, "rsw": 0.0625},
        configuration={"kernel": "p2p", "optimizer": {"lr": 0.003}},
    )


@pytest.fixture(scope="session")
def checkpoint(spec: SkillSpec, provenance: Provenance) -> dict[str, Any]:
    """Return the part of a training run's checkpoint that a skill needs."""
    members = build_skill(spec, seed=3).members
    for member in members.values():
        member.set_reward_scale(torch.tensor([2, 4]), torch.tensor([0.5, 0.25]))
    weights = {f"members.{name}.{key}": w for name, m in members.items() for key, w in m.state_dict().items()}
    return {"skill": skill_entry(spec, provenance, {}), "state_dict": weights, "epoch": 3}


@pytest.fixture
def skill_file(tmp_path: Path, checkpoint: dict[str, Any]) -> Path:
    path = tmp_path / "skill.ckpt"
    torch.save(checkpoint, path)
    return path
