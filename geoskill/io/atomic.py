"""Atomic writing: a file appears under its name only when complete; if writing fails, an older file stays as it was."""

import os
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any, Literal

_MARK = ".part"


@contextmanager
def atomic_path(path: Path) -> Iterator[Path]:
    """Yield a temporary path beside ``path`` that replaces it when the block ends without an error.

    The temporary file is hidden and keeps the suffix of ``path``. It is removed if the block raises.

    Raises:
        FileNotFoundError: when the block wrote no file.
    """
    # Unique among processes and threads that write the same file at the same time.
    writer = f"{os.getpid()}-{threading.get_ident()}"
    temporary = path.with_name(f".{path.stem}.{writer}{_MARK}{path.suffix}")
    try:
        yield temporary
        os.replace(temporary, path)
    finally:
        temporary.unlink(missing_ok=True)


@contextmanager
def atomic_open(path: Path, mode: Literal["w", "wb"] = "w", newline: str | None = None) -> Iterator[IO[Any]]:
    """Yield a file opened for writing (text as UTF-8) that replaces ``path`` when the block ends without an error."""
    with (
        atomic_path(path) as temporary,
        temporary.open(mode, encoding=None if mode == "wb" else "utf-8", newline=newline) as file,
    ):
        yield file


@contextmanager
def line_open(path: Path, *, as_they_come: bool) -> Iterator[IO[str]]:
    """Yield a file for lines of text (UTF-8), each of which others can read at once where that is asked for.

    Else, or where there is an earlier file, it appears or is replaced when the block ends without an error. A file
    without any line is not left.

    Args:
        path: of the file.
        as_they_come: whether lines are there once they are written, also when the block ends with an error.
    """
    if not as_they_come or path.exists():
        with atomic_open(path) as file:
            yield file
        return
    try:
        with path.open("w", encoding="utf-8", buffering=1) as file:
            yield file
    finally:
        if path.stat().st_size == 0:
            path.unlink()


def write_text(path: Path, text: str) -> None:
    """Replace a file by one with this text (UTF-8)."""
    with atomic_open(path) as file:
        file.write(text)


def remove_abandoned(folder: Path) -> None:
    """Remove what killed processes have left half written in a folder that only the present one writes into."""
    for path in folder.iterdir():
        if is_temporary(path) and path.is_file():
            path.unlink(missing_ok=True)


def is_temporary(path: Path) -> bool:
    """Return whether a file is named as :func:`atomic_path` names what is not complete yet."""
    return path.name.startswith(".") and _MARK in path.suffixes
