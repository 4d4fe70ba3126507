"""A cache of arrays on disk, shared by several processes."""

import os
import tempfile
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import TypeVar, final

import numpy as np
from platformdirs import user_cache_path

from geoskill.errors import InputError
from geoskill.io.archive import require_uninflated
from geoskill.io.atomic import atomic_open, is_temporary

# Fraction of the limit that may be written between two scans of the folder, and that is therefore kept free.
SLACK = 0.05
# After this time a temporary file is taken to be left over from a killed process.
ABANDONED_AFTER_S = 3600

Value = TypeVar("Value")


def default_folder() -> Path:
    """Return the user's cache folder for this package: on Linux in ``XDG_CACHE_HOME`` or ``~/.cache``.

    Without a home folder, a folder for temporary files is used.
    """
    # A user of a container may have no home folder: platformdirs raises then, or leaves "~" in older versions.
    with suppress(RuntimeError):
        folder = user_cache_path("geoskill", appauthor=False)
        if folder.parts[0] != "~":
            return folder
    return Path(tempfile.gettempdir()) / "geoskill"


@final
class DiskCache:
    """A cache with one file of arrays per key.

    Files are written atomically, so a reader sees a complete file or none; processes that compute the same value write
    the same bytes. A value that cannot be read is computed, and one that cannot be written is returned all the same:
    the cache never fails a run. Nor does a file of somebody else's take more memory than it is large.

    Args:
        folder: where the files are kept; created when first needed. None for the user's cache folder.
        limit_mb: largest size of the folder in megabytes; beyond it, the least recently used files are deleted.

    Raises:
        InputError: when ``limit_mb`` is not positive.
    """

    def __init__(self, folder: str | Path | None = None, limit_mb: float = 2000.0) -> None:
        if not limit_mb > 0:
            raise InputError(f"limit_mb={limit_mb}: expected a positive number of megabytes")
        self.folder = Path(folder) if folder else default_folder()
        self.limit_bytes = limit_mb * 1e6
        # Bytes since the last scan of the folder. It may be full of earlier runs' files, so the first write scans it.
        self._unscanned_bytes = self.limit_bytes

    def get_or_compute(
        self,
        key: str,
        compute: Callable[[], Value],
        pack: Callable[[Value], Mapping[str, np.ndarray]],
        unpack: Callable[[Mapping[str, np.ndarray]], Value],
    ) -> Value:
        """Return the value stored under a key; if there is none, compute and store it.

        Args:
            key: a hexadecimal digest of everything that the value depends on.
            compute: makes the value.
            pack: turns the value into arrays.
            unpack: turns arrays into the value. If it raises, the file is taken for another program's, and replaced.
        """
        path = self.folder / key[:2] / f"{key}.npz"
        value = _read(path, unpack)
        if value is None:
            value = compute()
            with suppress(OSError):
                self._store(path, pack(value))
        else:
            with suppress(OSError):  # a folder that cannot be written can still be read
                os.utime(path)  # marks the file as used, for `_evict`
        return value

    def _store(self, path: Path, arrays: Mapping[str, np.ndarray]) -> None:
        path.parent.mkdir(parents=True, exist_ok=True)
        with atomic_open(path, "wb") as file:
            np.savez(file, allow_pickle=False, **arrays)
        self._unscanned_bytes += path.stat().st_size
        # Scanning the folder at every write would cost more than it saves.
        if self._unscanned_bytes > self.limit_bytes * SLACK:
            self._unscanned_bytes = 0
            self._evict()

    def _evict(self) -> None:
        files = []
        for path in self.folder.glob("??/*"):
            try:
                status = path.stat()
            except FileNotFoundError:  # deleted by another process in the meantime
                continue
            if is_temporary(path):
                if time.time() - status.st_mtime > ABANDONED_AFTER_S:
                    path.unlink(missing_ok=True)
            elif path.suffix == ".npz":
                files.append((status.st_mtime, status.st_size, path))
        total = sum(size for _, size, _ in files)
        for _, size, path in sorted(files):
            if total <= self.limit_bytes * (1 - SLACK):
                break
            path.unlink(missing_ok=True)
            total -= size


def _read(path: Path, unpack: Callable[[Mapping[str, np.ndarray]], Value]) -> Value | None:
    try:
        # Opened here, because NumPy leaves broken archives open.
        with path.open("rb") as file, np.load(file, allow_pickle=False) as stored:
            require_uninflated(stored.zip, path.stat().st_size)
            return unpack(stored)
    except Exception:  # missing, truncated, or another program's file: NumPy raises a dozen types of errors
        return None
