"""The store as such; what it withstands on disk is tested through the cache of features that lies on it."""

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


def never() -> str:
    raise AssertionError("computed, though it was stored")


def test_what_is_stored_is_not_computed_again(tmp_path: Path) -> None:
    assert DiskCache(tmp_path).get_or_compute(KEY, lambda: "one", pack, unpack) == "one"
    # As in a later run: another object.
    assert DiskCache(tmp_path).get_or_compute(KEY, never, pack, unpack) == "one"
    assert DiskCache(tmp_path).get_or_compute("ab13", lambda: "two", pack, unpack) == "two"
    assert sorted(path.name for path in tmp_path.rglob("*.npz")) == ["ab12.npz", "ab13.npz"]


@pytest.mark.parametrize("error", [KeyError, ValueError, AssertionError])
def test_what_does_not_unpack_is_computed_again_and_replaced(tmp_path: Path, error: type[Exception]) -> None:
    store = DiskCache(tmp_path)
    store.get_or_compute(KEY, lambda: "old", pack, unpack)

    def refuse(arrays: Mapping[str, np.ndarray]) -> str:
        raise error("not ours")

    assert store.get_or_compute(KEY, lambda: "new", pack, refuse) == "new"
    assert store.get_or_compute(KEY, never, pack, unpack) == "new"


@pytest.mark.parametrize("limit_mb", [0.0, -1.0, float("nan")])
def test_a_limit_that_is_not_positive_is_refused(limit_mb: float) -> None:
    with pytest.raises(InputError, match=rf"^cache\.limit_mb={limit_mb}: expected a positive number of meg"):
        DiskCache(limit_mb=limit_mb)


def test_the_users_cache_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "xdg"))
    assert default_folder() == DiskCache().folder == tmp_path / "xdg" / "geoskill"
    monkeypatch.delenv("XDG_CACHE_HOME")
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    assert default_folder() == tmp_path / "home" / ".cache" / "geoskill"
    assert DiskCache(tmp_path).folder == DiskCache(str(tmp_path)).folder == tmp_path
