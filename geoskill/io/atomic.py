"""Files that are there whole or not at all: an older one stays when writing fails."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any, Literal


@contextmanager
def atomic_path(path: Path) -> Iterator[Path]:
    """Another path to write to; what is there takes its place when the block ends without an error."""
    temporary = path.with_name(f"{path.name}.{os.getpid()}.part")
    try:
        yield temporary
        os.replace(temporary, path)
    finally:
        temporary.unlink(missing_ok=True)


@contextmanager
def atomic_open(path: Path, mode: Literal["w", "wb"] = "w", newline: str | None = None) -> Iterator[IO[Any]]:
    """The same as an open file; text is UTF-8."""
    with (
        atomic_path(path) as temporary,
        temporary.open(mode, encoding=None if mode == "wb" else "utf-8", newline=newline) as file,
    ):
        yield file
