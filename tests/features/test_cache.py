"""The feature cache returns what would have been computed, whatever the state of its folder."""

import os
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import geoskill
from geoskill.features import cache as cache_module
from geoskill.features.cache import FeatureCache
from geoskill.features.feature_set import FeatureSet
from geoskill.geometry.primitives import NodeType
from geoskill.io import disk_cache
from geoskill.io.disk_cache import DiskCache


def frame_of(seed: int, height: int = 4, width: int = 6) -> np.ndarray:
    return np.random.default_rng(seed).integers(0, 256, (height, width, 3), dtype=np.uint8)


def features_of(seed: int, node_type: NodeType = NodeType.POINT, count: int = 5) -> FeatureSet:
    random = np.random.default_rng([seed, 1])
    return FeatureSet(
        node_type,
        random.normal(size=(count, 16)).astype(np.float32),
        random.normal(size=(count, node_type.geometry_dim)).astype(np.float32),
        np.sort(random.normal(size=count).astype(np.float32))[::-1],
    )


def assert_equal(found: FeatureSet, expected: FeatureSet) -> None:
    assert found.node_type is expected.node_type
    for name in ("descriptors", "geometry", "scores"):
        np.testing.assert_array_equal(getattr(found, name), getattr(expected, name), strict=True)


def fail() -> FeatureSet:
    raise AssertionError("computed, though it was stored")


def files_in(folder: Path) -> list[Path]:
    return sorted(path for path in folder.rglob("*") if path.is_file())


def size_of(folder: Path) -> int:
    return sum(path.stat().st_size for path in files_in(folder))


def is_stored(folder: Path, seed: int) -> bool:
    """Ask with another cache object, without counting as a use."""
    hit = True

    def compute() -> FeatureSet:
        nonlocal hit
        hit = False
        raise KeyboardInterrupt  # so that nothing is written

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(os, "utime", lambda path: None)
        try:
            FeatureCache(DiskCache(folder)).get_or_compute(frame_of(seed), "sift", compute)
        except KeyboardInterrupt:
            assert not hit
    return hit


@pytest.mark.parametrize("node_type", list(NodeType))
@pytest.mark.parametrize("count", [0, 1, 5])
def test_get_or_compute_returns_stored_features_without_computing(
    tmp_path: Path, node_type: NodeType, count: int
) -> None:
    expected = features_of(0, node_type, count)
    assert_equal(
        FeatureCache(DiskCache(tmp_path / "new" / "folder")).get_or_compute(frame_of(0), "sift", lambda: expected),
        expected,
    )
    # Another object, as in a later run.
    assert_equal(
        FeatureCache(DiskCache(tmp_path / "new" / "folder")).get_or_compute(frame_of(0), "sift", fail), expected
    )


def test_key_depends_on_content_shape_identity_and_format(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    cache = FeatureCache(DiskCache(tmp_path))
    frame = frame_of(0)
    cache.get_or_compute(frame, "sift", lambda: features_of(0))
    one_level_brighter = frame.copy()
    one_level_brighter[3, 5, 2] ^= 1
    misses = [
        (one_level_brighter, "sift"),
        (frame, "sift "),
        (frame, "orb"),
        (frame.reshape(6, 4, 3), "sift"),  # the same bytes in another shape
        (frame[:2], "sift"),
    ]
    for number, (image, identity) in enumerate(misses, start=1):
        assert_equal(cache.get_or_compute(image, identity, lambda: features_of(number)), features_of(number))  # noqa: B023
    monkeypatch.setattr(cache_module, "FORMAT", cache_module.FORMAT + 1)
    assert_equal(cache.get_or_compute(frame, "sift", lambda: features_of(99)), features_of(99))
    assert len(files_in(tmp_path)) == 7


def test_key_of_a_view_is_that_of_its_content(tmp_path: Path) -> None:
    cache = FeatureCache(DiskCache(tmp_path))
    wide = np.repeat(frame_of(0), 2, axis=1)
    cache.get_or_compute(frame_of(0), "sift", lambda: features_of(0))
    assert_equal(cache.get_or_compute(wide[:, ::2], "sift", fail), features_of(0))
    assert_equal(cache.get_or_compute(np.asfortranarray(frame_of(0)), "sift", fail), features_of(0))


def check_recovery(tmp_path: Path, damage: Callable[[bytes], bytes]) -> None:
    """Damage the only file, then expect the right features, and a repaired file for the next reader."""
    cache = FeatureCache(DiskCache(tmp_path))
    cache.get_or_compute(frame_of(0), "sift", lambda: features_of(0))
    (path,) = files_in(tmp_path)
    path.write_bytes(damage(path.read_bytes()))
    assert_equal(cache.get_or_compute(frame_of(0), "sift", lambda: features_of(0)), features_of(0))
    assert_equal(cache.get_or_compute(frame_of(0), "sift", fail), features_of(0))
    assert files_in(tmp_path) == [path]


@pytest.mark.parametrize("share", [0.0, 0.05, 0.3, 0.6, 0.9, 0.999])
def test_truncated_file_is_recomputed(tmp_path: Path, share: float) -> None:
    check_recovery(tmp_path, lambda content: content[: int(share * len(content))])


@pytest.mark.parametrize(
    "content",
    [b"not ours", b"\x93NUMPY", b"PK\x03\x04 half a header", b"\x80\x04]\x94.", bytes(1000)],
    ids=["text", "npy", "zip", "pickle", "zeros"],
)
def test_file_of_another_format_is_recomputed(tmp_path: Path, content: bytes) -> None:
    check_recovery(tmp_path, lambda _: content)


def test_archive_of_other_arrays_is_recomputed(tmp_path: Path) -> None:
    cache = FeatureCache(DiskCache(tmp_path))
    cache.get_or_compute(frame_of(0), "sift", lambda: features_of(0))
    (path,) = files_in(tmp_path)
    np.savez(path, node_type="plane", descriptors=np.zeros((1, 2)))
    assert_equal(cache.get_or_compute(frame_of(0), "sift", lambda: features_of(0)), features_of(0))


def test_flipped_bit_never_changes_the_features(tmp_path: Path) -> None:
    """The archive's checksums detect flipped bits, except in parts that do not matter."""
    cache = FeatureCache(DiskCache(tmp_path))
    cache.get_or_compute(frame_of(0), "sift", lambda: features_of(0))
    (path,) = files_in(tmp_path)
    content = path.read_bytes()
    recomputed = 0

    def compute() -> FeatureSet:
        nonlocal recomputed
        recomputed += 1
        return features_of(0)

    for position in range(0, len(content), 17):
        broken = bytearray(content)
        broken[position] ^= 0x10
        path.write_bytes(bytes(broken))
        assert_equal(cache.get_or_compute(frame_of(0), "sift", compute), features_of(0))
    assert recomputed > 30


def test_file_in_place_of_the_folder_does_no_harm(tmp_path: Path) -> None:
    blocked = tmp_path / "cache"
    blocked.write_text("a file")
    for _ in range(2):
        assert_equal(
            FeatureCache(DiskCache(blocked)).get_or_compute(frame_of(0), "sift", lambda: features_of(0)),
            features_of(0),
        )
    assert blocked.read_text() == "a file"


def test_read_only_folder_is_still_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    cache = FeatureCache(DiskCache(tmp_path))
    cache.get_or_compute(frame_of(0), "sift", lambda: features_of(0))

    def refuse(*args: object, **kwargs: object) -> None:
        raise PermissionError("read-only file system")

    monkeypatch.setattr(os, "utime", refuse)
    monkeypatch.setattr(disk_cache, "atomic_open", refuse)
    assert_equal(cache.get_or_compute(frame_of(0), "sift", fail), features_of(0))
    assert_equal(cache.get_or_compute(frame_of(1), "sift", lambda: features_of(1)), features_of(1))
    assert len(files_in(tmp_path)) == 1


@pytest.mark.parametrize("step", ["savez", "replace"])
def test_full_disk_leaves_no_partial_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, step: str) -> None:
    def refuse(file: object, *args: object, **kwargs: object) -> None:
        if step == "savez":
            file.write(b"half a")  # type: ignore[attr-defined]
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(np if step == "savez" else os, step, refuse)
    assert_equal(
        FeatureCache(DiskCache(tmp_path)).get_or_compute(frame_of(0), "sift", lambda: features_of(0)), features_of(0)
    )
    assert files_in(tmp_path) == []


def test_interrupted_write_leaves_no_partial_file_and_raises(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupt(*args: object, **kwargs: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(np, "savez", interrupt)
    with pytest.raises(KeyboardInterrupt):
        FeatureCache(DiskCache(tmp_path)).get_or_compute(frame_of(0), "sift", lambda: features_of(0))
    assert files_in(tmp_path) == []


def test_error_of_the_extractor_is_not_swallowed(tmp_path: Path) -> None:
    def fail() -> FeatureSet:
        raise OSError("the extractor's own")

    with pytest.raises(OSError, match="the extractor's own"):
        FeatureCache(DiskCache(tmp_path)).get_or_compute(frame_of(0), "sift", fail)
    assert files_in(tmp_path) == []


def entry_bytes(tmp_path: Path) -> int:
    folder = tmp_path / "one entry"
    FeatureCache(DiskCache(folder)).get_or_compute(frame_of(0), "sift", lambda: features_of(0))
    return size_of(folder)


def test_eviction_deletes_the_least_recently_used_entry(tmp_path: Path) -> None:
    folder = tmp_path / "cache"
    cache = FeatureCache(DiskCache(folder, limit_mb=4.5 * entry_bytes(tmp_path) / 1e6))  # room for four
    for seed in range(4):
        before = set(files_in(folder))
        cache.get_or_compute(frame_of(seed), "sift", lambda: features_of(seed))  # noqa: B023
        (path,) = set(files_in(folder)) - before
        os.utime(path, (1000 + seed, 1000 + seed))
    cache.get_or_compute(frame_of(0), "sift", fail)  # the oldest is used again
    cache.get_or_compute(frame_of(4), "sift", lambda: features_of(4))
    assert [is_stored(folder, seed) for seed in range(5)] == [True, False, True, True, True]
    cache.get_or_compute(frame_of(5), "sift", lambda: features_of(5))
    assert [is_stored(folder, seed) for seed in range(6)] == [True, False, False, True, True, True]


def test_folder_never_exceeds_the_limit(tmp_path: Path) -> None:
    folder = tmp_path / "cache"
    limit = 30.5 * entry_bytes(tmp_path)
    cache = FeatureCache(DiskCache(folder, limit_mb=limit / 1e6))
    largest = 0
    for seed in range(80):
        cache.get_or_compute(frame_of(seed), "sift", lambda: features_of(seed))  # noqa: B023
        largest = max(largest, size_of(folder))
        assert is_stored(folder, seed)
    assert 0.9 * limit < largest <= limit
    assert size_of(folder) > 0.85 * limit


def test_many_short_runs_do_not_exceed_the_limit(tmp_path: Path) -> None:
    """None of the runs writes enough to trigger a scan of the folder, but each scans once."""
    folder = tmp_path / "cache"
    limit = 30.5 * entry_bytes(tmp_path)
    for seed in range(60):
        FeatureCache(DiskCache(folder, limit_mb=limit / 1e6)).get_or_compute(
            frame_of(seed),
            "sift",
            lambda: features_of(seed),  # noqa: B023
        )
    assert 0.8 * limit < size_of(folder) <= limit


def test_eviction_deletes_abandoned_temporary_files_after_an_hour(tmp_path: Path) -> None:
    for name, age_s in ((".old.1-2.part.npz", 4000), (".fresh.1-2.part.npz", 60)):
        (tmp_path / "ab").mkdir(exist_ok=True)
        (tmp_path / "ab" / name).write_bytes(b"half a file")
        os.utime(tmp_path / "ab" / name, (time.time() - age_s,) * 2)
    (tmp_path / "ab" / "not_ours.txt").write_text("kept")
    FeatureCache(DiskCache(tmp_path)).get_or_compute(frame_of(0), "sift", lambda: features_of(0))
    entry = next(path for path in files_in(tmp_path) if path.parent.name != "ab" or len(path.stem) == 64)
    assert [path.name for path in files_in(tmp_path) if path != entry] == [".fresh.1-2.part.npz", "not_ours.txt"]


PROCESS = """
import sys, time
from pathlib import Path
import numpy as np
from geoskill.io.disk_cache import DiskCache
from geoskill.features import cache as cache_module
from geoskill.features.cache import FeatureCache
from geoskill.features.feature_set import FeatureSet
from geoskill.geometry.primitives import NodeType

folder, meeting, me, other, limit_mb = Path(sys.argv[1]), Path(sys.argv[2]), *sys.argv[3:5], float(sys.argv[5])
computed = 0

def expected(key):
    global computed
    computed += 1
    rows = np.full((40, 128), key, np.float32)
    return FeatureSet(NodeType.POINT, rows, rows[:, :2] + 1, rows[:, 0] + 2)

cache = FeatureCache(DiskCache(folder, limit_mb))
(meeting / me).touch()
deadline = time.monotonic() + 20
while not (meeting / other).exists():
    assert time.monotonic() < deadline, "the other process did not start"
for turn in range(15):
    for key in range(8):
        frame = np.full((4, 4, 3), key, np.uint8)
        features = cache.get_or_compute(frame, f"sift {turn}", lambda: expected(key))
        assert features.node_type is NodeType.POINT
        assert features.descriptors.shape == (40, 128) and (features.descriptors == key).all()
        assert (features.geometry == key + 1).all() and (features.scores == key + 2).all()
print(computed)
"""


@pytest.mark.slow
@pytest.mark.parametrize("limit_mb", [500.0, 0.1], ids=["roomy", "evicting"])
def test_two_processes_share_a_folder(tmp_path: Path, limit_mb: float) -> None:
    folder, meeting = tmp_path / "cache", tmp_path / "meeting"
    meeting.mkdir()
    environment = os.environ | {"PYTHONPATH": str(Path(geoskill.__file__).parents[1])}
    processes = [
        subprocess.Popen(
            [sys.executable, "-c", PROCESS, str(folder), str(meeting), *names, str(limit_mb)],
            env=environment,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        for names in (("a", "b"), ("b", "a"))
    ]
    outputs = [process.communicate(timeout=60) for process in processes]
    assert [process.returncode for process in processes] == [0, 0], outputs
    computed = [int(output) for output, _ in outputs]
    assert 120 <= sum(computed) <= 240  # each of 15 x 8 entries by at least one of the two
    assert {path.suffix for path in files_in(folder)} == {".npz"}
    if limit_mb == 500.0:
        assert len(files_in(folder)) == 120
    else:
        assert size_of(folder) <= 2 * limit_mb * 1e6
