"""What all tests share."""

from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import yaml

from geoskill.skill.description import describe

CONFIGURATION = Path(__file__).resolve().parents[1] / "conf"
# The demonstrations are no part of this repository; they lie in a folder beside it.
BLOCKS = Path(__file__).resolve().parents[2] / "shared" / "data" / "blocks"


@pytest.fixture(scope="session")
def blocks() -> Path:
    """The folder of the real demonstration: human1/, robot1/ and their regions."""
    if not BLOCKS.is_dir():
        pytest.skip(f"the real demonstrations are not there; expected the folder {BLOCKS}")
    return BLOCKS


@pytest.fixture(scope="session")
def demonstration_frames() -> tuple[np.ndarray, ...]:
    """20 RGB frames of 120 rows x 160 columns: a patterned tile slides 2.5 pixels a frame to the right, up to another.

    The moving tile covers x 28 to 60, y 46 to 78 in the first frame, x 75.5 to 107.5 in the last; the resting tile
    x 108 to 140 throughout. Below both, a third tile that has nothing to do with it rests at x 60 to 92, y 88 to 120.
    """
    generator = np.random.default_rng(3)
    moving, target, bystander = (
        np.kron(generator.integers(30, 226, (4, 4, 3)), np.ones((8, 8, 1))).astype(np.uint8) for _ in range(3)
    )
    background = np.full((120, 160, 3), 128, np.uint8)
    background[46:78, 108:140] = target
    background[88:120, 60:92] = bystander
    frames = []
    for number in range(20):
        frame = background.copy()
        shift = np.array([[1, 0, 28 + 2.5 * number], [0, 1, 46]], np.float32)
        cv2.warpAffine(moving, shift, (160, 120), dst=frame, borderMode=cv2.BORDER_TRANSPARENT)
        frames.append(frame)
    return tuple(frames)


@pytest.fixture(scope="session")
def demonstration_folder(
    tmp_path_factory: pytest.TempPathFactory, demonstration_frames: tuple[np.ndarray, ...]
) -> Path:
    """The same as a folder of PNG files; read only."""
    folder = tmp_path_factory.mktemp("demonstration")
    for number, frame in enumerate(demonstration_frames):
        cv2.imwrite(str(folder / f"{number:03d}.png"), frame[:, :, ::-1])
    return folder


@pytest.fixture(scope="session")
def small_model() -> dict[str, Any]:
    """The default network as configured, but of 8 hidden units and 2 steps."""
    settings = yaml.safe_load((CONFIGURATION / "model" / "default.yaml").read_text(encoding="utf-8"))
    assert {"hidden_dim", "layers"} <= settings.keys()
    return {**settings, "hidden_dim": 8, "layers": 2}


@pytest.fixture(scope="session")
def description(small_model: dict[str, Any]) -> dict[str, Any]:
    """A skill of two members, p2p_sift and p2l_sift_lbd, with 10 features of a kind and 4 alternatives each."""
    return describe(
        {
            "p2p": {"_target_": "geoskill.kernels.p2p.PointToPoint"},
            "p2l": {"_target_": "geoskill.kernels.p2l.PointToLine"},
        },
        {"sift": {"_target_": "geoskill.features.sift.Sift"}, "lbd": {"_target_": "geoskill.features.lbd.Lbd"}},
        small_model,
        {"max_features": 10, "min_side": 0},
        alternatives=4,
    )
