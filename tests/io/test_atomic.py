"""Atomic writing: a file replaces an older one only when it is complete."""

import threading
from pathlib import Path

import pytest

from geoskill.io.atomic import atomic_open, atomic_path, is_temporary, line_open


def test_atomic_open_and_path_replace_an_older_file_when_complete(tmp_path: Path) -> None:
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


def test_atomic_open_and_path_keep_an_older_file_when_writing_fails(tmp_path: Path) -> None:
    path = tmp_path / "metrics.json"
    path.write_text("older")
    with pytest.raises(RuntimeError, match="the disk is full"), atomic_open(path) as file:
        file.write("half")
        raise RuntimeError("the disk is full")
    with pytest.raises(FileNotFoundError), atomic_path(path):
        pass  # nothing was written
    assert path.read_text() == "older"
    assert list(tmp_path.iterdir()) == [path]


def test_atomic_path_is_hidden_keeps_the_suffix_and_is_recognized(tmp_path: Path) -> None:
    path = tmp_path / "overlay.mp4"
    with atomic_path(path) as temporary:
        assert (temporary.parent, temporary.suffix, temporary.name[0]) == (tmp_path, ".mp4", ".")
        assert is_temporary(temporary)
        assert not is_temporary(path)
        temporary.write_bytes(b"")


def test_atomic_path_differs_between_threads(tmp_path: Path) -> None:
    names: list[Path] = []
    together = threading.Barrier(2, timeout=10)

    def write() -> None:
        with atomic_path(tmp_path / "a.npz") as temporary:
            temporary.write_bytes(b"")
            names.append(temporary)
            together.wait()

    threads = [threading.Thread(target=write) for _ in range(2)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(set(names)) == 2
    assert [path.name for path in tmp_path.iterdir()] == ["a.npz"]


def test_lines_are_there_as_they_come(tmp_path: Path) -> None:
    path = tmp_path / "lines.jsonl"
    with pytest.raises(RuntimeError), line_open(path, as_they_come=True) as file:
        file.write("1\n")
        assert path.read_text() == "1\n"
        raise RuntimeError
    assert path.read_text() == "1\n"
    # Earlier lines are replaced only by a complete file.
    with pytest.raises(RuntimeError), line_open(path, as_they_come=True) as file:
        file.write("2\n")
        raise RuntimeError
    assert path.read_text() == "1\n"
    with line_open(path, as_they_come=False) as file:
        file.write("3\n")
        assert path.read_text() == "1\n"
    assert path.read_text() == "3\n"
    with pytest.raises(RuntimeError), line_open(tmp_path / "empty", as_they_come=True):
        raise RuntimeError
    assert [own.name for own in tmp_path.iterdir()] == ["lines.jsonl"]
