"""Arrays on disk that can be computed again: a cache that several runs share."""

import os
import tempfile
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import TypeVar, final

import numpy as np

from geoskill.errors import InputError

# The part of the limit that may be written between two looks at the whole folder, and is kept free for it.
SLACK = 0.05

T = TypeVar("T")


def default_folder() -> Path:
    """The user's cache folder, by the XDG base directory rule."""
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "geoskill"


@final
class DiskCache:
    """One file of arrays per key.

    A file is written under a temporary name and renamed, so a reader sees a whole file or none; two runs that compute
    the same thing write the same bytes. What cannot be read or written is computed: the store never fails a run.

    Args:
        folder: where the files lie; made when first needed. None for the user's cache folder.
        limit_mb: megabytes the folder may hold; above it, the files that were not used for longest go.

    Raises:
        InputError: when ``limit_mb`` is not positive.
    """

    def __init__(self, folder: str | Path | None = None, limit_mb: float = 2000.0) -> None:
        if not limit_mb > 0:
            raise InputError(f"cache.limit_mb={limit_mb}: expected a positive number of megabytes")
        self.folder = Path(folder) if folder else default_folder()
        self.limit_bytes = limit_mb * 1e6
        # Since the folder was last looked through; at the start as if much, for it may be full of earlier runs' files.
        self._written = self.limit_bytes

    def get_or_compute(
        self,
        key: str,
        compute: Callable[[], T],
        pack: Callable[[T], Mapping[str, np.ndarray]],
        unpack: Callable[[Mapping[str, np.ndarray]], T],
    ) -> T:
        """What is stored under a key, or the result of ``compute``, which is then stored.

        Args:
            key: a hexadecimal digest of everything that the result depends on.
            compute: makes the result.
            pack: turns it into arrays.
            unpack: turns arrays into it; whatever it raises means that the file is not ours, and computed again.
        """
        path = self.folder / key[:2] / f"{key}.npz"
        found = _read(path, unpack)
        if found is None:
            found = compute()
            with suppress(OSError):
                self._store(path, pack(found))
        else:
            with suppress(OSError):  # a folder that cannot be written can still be read
                os.utime(path)  # marks it as used, for `_evict`
        return found

    def _store(self, path: Path, arrays: Mapping[str, np.ndarray]) -> None:
        path.parent.mkdir(parents=True, exist_ok=True)
        handle, temporary = tempfile.mkstemp(dir=path.parent, suffix=".part")
        try:
            with os.fdopen(handle, "wb") as file:
                np.savez(file, allow_pickle=False, **arrays)
            os.replace(temporary, path)
        except BaseException:
            Path(temporary).unlink(missing_ok=True)
            raise
        self._written += path.stat().st_size
        # Walking the folder at every file would cost more than it saves.
        if self._written > self.limit_bytes * SLACK:
            self._written = 0
            self._evict()

    def _evict(self) -> None:
        files = []
        for path in self.folder.glob("??/*"):
            try:
                status = path.stat()
            except FileNotFoundError:  # another run was quicker
                continue
            if path.suffix == ".part" and time.time() - status.st_mtime > 3600:
                path.unlink(missing_ok=True)  # left by a run that was killed
            elif path.suffix == ".npz":
                files.append((status.st_mtime, status.st_size, path))
        total = sum(size for _, size, _ in files)
        for _, size, path in sorted(files):
            if total <= self.limit_bytes * (1 - SLACK):
                break
            path.unlink(missing_ok=True)
            total -= size


def _read(path: Path, unpack: Callable[[Mapping[str, np.ndarray]], T]) -> T | None:
    try:
        # Opened here, for NumPy leaves broken archives open.
        with path.open("rb") as file, np.load(file, allow_pickle=False) as stored:
            return unpack(stored)
    except Exception:  # absent, half a file of a full disk, or not ours: NumPy raises a dozen kinds of errors
        return None
