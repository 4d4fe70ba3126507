"""What the attacks share: how many there are, and a small skill to attack.

``make robustness`` makes two thousand of each kind; by default there are as many as take a few minutes.
"""

import os
from collections.abc import Callable, Sequence
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch

from geoskill.skill.checkpoint import Provenance, skill_entry, write_checkpoint
from geoskill.skill.spec import SkillSpec, build_skill


def pytest_collection_modifyitems(items: Sequence[pytest.Item]) -> None:
    for item in items:
        if Path(__file__).parent in item.path.parents:
            item.add_marker(pytest.mark.slow)


@pytest.fixture(scope="session")
def rounds() -> int:
    """How many attacks of a kind."""
    return int(os.environ.get("ROBUSTNESS_ROUNDS", "100"))


@pytest.fixture(scope="session")
def small_skill(spec: SkillSpec, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An untrained skill of two members that says it is finished."""
    members = build_skill(spec, seed=3).members
    for member in members.values():
        member.set_reward_scale(torch.tensor([2, 4]), torch.tensor([0.5, 0.25]))
        member.set_reference_margin(torch.tensor(1.0))
    provenance = Provenance(("tiles.mp4",), (160, 120), "2026-02-03", "1", 7, finished=True, epochs=(2, 2))
    weights = {f"members.{name}.{key}": w for name, m in members.items() for key, w in m.state_dict().items()}
    path: Path = tmp_path_factory.mktemp("skill") / "skill.ckpt"
    write_checkpoint(path, {"skill": skill_entry(spec, provenance, {}), "state_dict": weights})
    return path


@pytest.fixture(scope="session")
def small_picture(demonstration_frames: tuple[np.ndarray, ...]) -> Callable[[str], bytes]:
    """``small_picture(".png")`` is the content of a picture of this type."""

    def encoded(suffix: str) -> bytes:
        return bytes(cv2.imencode(suffix, demonstration_frames[0])[1])

    return encoded
