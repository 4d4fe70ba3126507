"""What all tests share."""

from pathlib import Path

import pytest

# The demonstrations are no part of this repository; they lie in a folder beside it.
BLOCKS = Path(__file__).resolve().parents[2] / "shared" / "data" / "blocks"


@pytest.fixture(scope="session")
def blocks() -> Path:
    """The folder of the real demonstration: human1/, robot1/ and their regions."""
    if not BLOCKS.is_dir():
        pytest.skip(f"the real demonstrations are not there; expected the folder {BLOCKS}")
    return BLOCKS
