"""A file takes the place of an older one when it is complete, and not before."""

from pathlib import Path

import pytest

from geoskill.io.atomic import atomic_open, atomic_path


def test_a_complete_file_takes_the_place_of_the_older_one(tmp_path: Path) -> None:
    path = tmp_path / "metrics.json"
    path.write_text("older")
    with atomic_open(path) as file:
        file.write("never mind: é")
        assert path.read_text() == "older"
    assert path.read_text(encoding="utf-8") == "never mind: é"
    with atomic_open(path, "wb") as file:
        file.write(b"bytes")
    assert path.read_bytes() == b"bytes"
    with atomic_path(path) as temporary:
        temporary.write_text("by its path")
    assert path.read_text() == "by its path"
    assert list(tmp_path.iterdir()) == [path]


def test_an_older_file_stays_when_writing_fails(tmp_path: Path) -> None:
    path = tmp_path / "metrics.json"
    path.write_text("older")
    with pytest.raises(RuntimeError, match="the disk is full"), atomic_open(path) as file:
        file.write("half")
        raise RuntimeError("the disk is full")
    with pytest.raises(FileNotFoundError), atomic_path(path):
        pass  # nothing was written
    assert path.read_text() == "older"
    assert list(tmp_path.iterdir()) == [path]
