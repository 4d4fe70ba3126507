"""A lock on a folder that one process at a time may write results into."""

import os
import socket
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from datetime import datetime
from pathlib import Path
from typing import IO

from geoskill.errors import InputError
from geoskill.io.atomic import remove_abandoned

try:
    import fcntl
except ImportError:  # Windows has no such locks, and no clusters of ours
    fcntl = None  # type: ignore[assignment]

LOCK = ".lock"


@contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Keep a folder for this process while the block runs, freed of what a killed process has left half written.

    The lock ends with the process, however that ends; the file may stay behind, and then keeps nobody out. Where the
    file system has no locks there is none.

    Args:
        folder: an existing one.

    Raises:
        InputError: when another process has it; the message names that one.
        OSError: when nothing can be written there.
    """
    file = _acquired(folder / LOCK)
    try:
        remove_abandoned(folder)
        yield
    finally:
        (folder / LOCK).unlink(missing_ok=True)
        file.close()


def _acquired(path: Path) -> IO[str]:
    while True:
        file = path.open("a+", encoding="utf-8")
        try:
            _lock(file, path)
        except BaseException:
            file.close()
            raise
        with suppress(FileNotFoundError):
            # Its former owner may have removed it between the opening and the locking.
            if os.fstat(file.fileno()).st_ino == path.stat().st_ino:
                break
        file.close()
    file.truncate(0)
    now = datetime.now().astimezone().isoformat(sep=" ", timespec="seconds")
    file.write(f"process {os.getpid()} on {socket.gethostname()}, since {now}")
    file.flush()
    return file


def _lock(file: IO[str], path: Path) -> None:
    if fcntl is None:
        return
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        file.seek(0)
        owner = file.read(200).strip() or "another process"
        raise InputError(
            f"{path.parent}: is being written by {owner}; expected another folder (hydra.run.dir=…), or its end"
        ) from None
    except OSError:  # a file system without locks
        pass
