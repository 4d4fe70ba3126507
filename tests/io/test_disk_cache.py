"""The disk cache by itself; its behavior with damaged files is tested in ``tests/features/test_cache.py``."""

import subprocess
import sys
import tempfile
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest

from geoskill.errors import InputError
from geoskill.io.disk_cache import DiskCache, default_folder

KEY = "ab12"


def pack(text: str) -> dict[str, np.ndarray]:
    return {"text": np.array(text)}


def unpack(arrays: Mapping[str, np.ndarray]) -> str:
    return str(arrays["text"])


def fail() -> str:
    raise AssertionError("computed, though it was stored")


def test_get_or_compute_does_not_compute_a_stored_value(tmp_path: Path) -> None:
    assert DiskCache(tmp_path).get_or_compute(KEY, lambda: "one", pack, unpack) == "one"
    # Another object, as in a later run.
    assert DiskCache(tmp_path).get_or_compute(KEY, fail, pack, unpack) == "one"
    assert DiskCache(tmp_path).get_or_compute("ab13", lambda: "two", pack, unpack) == "two"
    assert sorted(path.name for path in tmp_path.rglob("*.npz")) == ["ab12.npz", "ab13.npz"]


@pytest.mark.parametrize("error", [KeyError, ValueError, AssertionError])
def test_get_or_compute_replaces_a_file_that_does_not_unpack(tmp_path: Path, error: type[Exception]) -> None:
    cache = DiskCache(tmp_path)
    cache.get_or_compute(KEY, lambda: "old", pack, unpack)

    def refuse(arrays: Mapping[str, np.ndarray]) -> str:
        raise error("not ours")

    assert cache.get_or_compute(KEY, lambda: "new", pack, refuse) == "new"
    assert cache.get_or_compute(KEY, fail, pack, unpack) == "new"


def test_a_file_that_inflates_is_replaced(tmp_path: Path) -> None:
    path = tmp_path / KEY[:2] / f"{KEY}.npz"
    path.parent.mkdir()
    np.savez_compressed(path, text=np.array("x" * 1_000_000))
    assert path.stat().st_size < 100_000
    assert DiskCache(tmp_path).get_or_compute(KEY, lambda: "new", pack, unpack) == "new"
    assert DiskCache(tmp_path).get_or_compute(KEY, fail, pack, unpack) == "new"


@pytest.mark.parametrize("limit_mb", [0.0, -1.0, float("nan")])
def test_limit_must_be_positive(limit_mb: float) -> None:
    with pytest.raises(InputError, match=rf"^limit_mb={limit_mb}: expected a positive number of meg"):
        DiskCache(limit_mb=limit_mb)


@pytest.mark.skipif(sys.platform != "linux", reason="other systems have other cache folders")
def test_default_folder_is_the_users_cache_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "xdg"))
    assert default_folder() == DiskCache().folder == tmp_path / "xdg" / "geoskill"
    monkeypatch.delenv("XDG_CACHE_HOME")
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    assert default_folder() == tmp_path / "home" / ".cache" / "geoskill"
    assert DiskCache(tmp_path).folder == DiskCache(str(tmp_path)).folder == tmp_path


@pytest.mark.skipif(sys.platform != "linux", reason="user numbers are those of Linux")
def test_default_folder_without_a_home_is_a_temporary_one(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
    monkeypatch.setattr("os.path.expanduser", lambda path: path)  # as without HOME and without an entry in passwd
    assert default_folder() == DiskCache().folder == Path(tempfile.gettempdir()) / "geoskill"


@pytest.mark.skipif(sys.platform != "linux", reason="user numbers are those of Linux")
def test_import_without_a_home() -> None:
    ended = subprocess.run(
        [sys.executable, "-c", "import geoskill.io.disk_cache"], env={"PYTHONPATH": ":".join(sys.path)}
    )
    assert ended.returncode == 0
