"""Extracted features on disk, found again by the frame's content and the pipeline's identity."""

import hashlib
import os
import tempfile
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import final

import numpy as np
from jaxtyping import UInt8

from geoskill.errors import InputError
from geoskill.features.feature_set import FeatureSet
from geoskill.geometry.primitives import NodeType

# Raise it when the meaning of what an extractor returns changes without its settings changing.
FORMAT = 1
# The part of the limit that may be written between two looks at the whole folder, and is kept free for it.
SLACK = 0.05


def default_folder() -> Path:
    """The user's cache folder, by the XDG base directory rule."""
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "geoskill"


@final
class FeatureCache:
    """One file per frame and pipeline.

    A file is written under a temporary name and renamed, so a reader sees a whole file or none; two runs that compute
    the same frame write the same bytes. What cannot be read or written is computed: the cache never fails a run.

    Args:
        folder: where the files lie; made when first needed. None for the user's cache folder.
        limit_mb: megabytes the folder may hold; above it, the files that were not used for longest go.

    Raises:
        InputError: when ``limit_mb`` is not positive.
    """

    def __init__(self, folder: str | Path | None = None, limit_mb: float = 500.0) -> None:
        if not limit_mb > 0:
            raise InputError(f"features.cache.limit_mb={limit_mb}: expected a positive number of megabytes")
        self.folder = Path(folder) if folder else default_folder()
        self.limit_bytes = limit_mb * 1e6
        # Since the folder was last looked through; at the start as if much, for it may be full of earlier runs' files.
        self._written = self.limit_bytes

    def get_or_compute(
        self, frame: UInt8[np.ndarray, "height width 3"], identity: str, compute: Callable[[], FeatureSet]
    ) -> FeatureSet:
        """The stored features of this frame under this identity, or those of ``compute``, which are then stored."""
        path = self._path(frame, identity)
        features = _load(path)
        if features is None:
            features = compute()
            with suppress(OSError):
                self._store(path, features)
        else:
            with suppress(OSError):  # a folder that cannot be written can still be read
                os.utime(path)  # marks it as used, for `_evict`
        return features

    def _path(self, frame: UInt8[np.ndarray, "height width 3"], identity: str) -> Path:
        digest = hashlib.sha256(f"{FORMAT} {identity} {frame.shape}".encode())
        digest.update(np.ascontiguousarray(frame).data)
        name = digest.hexdigest()
        return self.folder / name[:2] / f"{name}.npz"

    def _store(self, path: Path, features: FeatureSet) -> None:
        path.parent.mkdir(parents=True, exist_ok=True)
        handle, temporary = tempfile.mkstemp(dir=path.parent, suffix=".part")
        try:
            with os.fdopen(handle, "wb") as file:
                np.savez(
                    file,
                    node_type=str(features.node_type),
                    descriptors=features.descriptors,
                    geometry=features.geometry,
                    strength=features.strength,
                )
            os.replace(temporary, path)
        except BaseException:
            Path(temporary).unlink(missing_ok=True)
            raise
        self._written += path.stat().st_size
        # Walking the folder at every frame would cost more than it saves.
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


def _load(path: Path) -> FeatureSet | None:
    try:
        # Opened here, for NumPy leaves broken archives open.
        with path.open("rb") as file, np.load(file, allow_pickle=False) as stored:
            return FeatureSet(
                NodeType(str(stored["node_type"])), stored["descriptors"], stored["geometry"], stored["strength"]
            )
    except Exception:  # absent, half a file of a full disk, or not ours: NumPy raises a dozen kinds of errors
        return None
