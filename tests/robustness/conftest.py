"""What the attacks share: how many there are, and a small picture to attack.

``make robustness`` makes two thousand of each kind; by default there are as many as take a few minutes.
"""

import os
from collections.abc import Callable, Sequence
from pathlib import Path

import cv2
import numpy as np
import pytest


def pytest_collection_modifyitems(items: Sequence[pytest.Item]) -> None:
    for item in items:
        if Path(__file__).parent in item.path.parents:
            item.add_marker(pytest.mark.slow)


@pytest.fixture(scope="session")
def rounds() -> int:
    """How many attacks of a kind."""
    return int(os.environ.get("ROBUSTNESS_ROUNDS", "100"))


@pytest.fixture(scope="session")
def small_picture(demonstration_frames: tuple[np.ndarray, ...]) -> Callable[[str], bytes]:
    """``small_picture(".png")`` is the content of a picture of this type."""

    def encoded(suffix: str) -> bytes:
        return bytes(cv2.imencode(suffix, demonstration_frames[0])[1])

    return encoded
