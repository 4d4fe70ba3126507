"""A process that reads one damaged file after the other within limits, and says how each ended.

``python reader.py KIND SKILL FILE…`` writes a line of JSON for each file: its name, how it ended (``read``, ``refused``
or the error that nobody caught), seconds, and by how many megabytes the largest memory of the process has grown.
"""

import json
import resource
import shutil
import signal
import sys
import tempfile
import time
import warnings
from collections.abc import Callable
from pathlib import Path

import numpy as np

from geoskill.errors import InputError
from geoskill.evaluation.annotations.assignment import RoleNames
from geoskill.evaluation.annotations.load import load_regions
from geoskill.features.cache import FeatureCache
from geoskill.features.sift import Sift
from geoskill.io.disk_cache import DiskCache
from geoskill.io.image_folder import ImageFolder
from geoskill.io.video import VideoFile
from geoskill.skill.skill import Skill

MEMORY_BYTES = 2_000_000_000
SECONDS = 60
FRAME = np.kron(np.random.default_rng(0).integers(0, 256, (12, 16, 3)), np.ones((10, 10, 1))).astype(np.uint8)


def checkpoint(path: Path) -> None:
    Skill.load(path).infer(FRAME)


def regions(path: Path) -> None:
    read = load_regions(path, (160, 120), 20)
    for frame in range(20):
        labels = read.at(frame)
        assert labels is None or labels.label((10.0, 10.0)) in (None, *labels.polygons)


def labels(path: Path) -> None:
    read = load_regions(path, (160, 120), 20, RoleNames("mug", "coaster"))
    for frame in range(20):
        at = read.at(frame)
        assert at is None or at.label((10.0, 10.0)) in (None, *at.polygons)


def cache(path: Path) -> None:
    with tempfile.TemporaryDirectory() as folder:
        key = "ab" * 32
        (Path(folder) / key[:2]).mkdir()
        shutil.copy(path, Path(folder) / key[:2] / f"{key}.npz")
        store = DiskCache(folder)
        lookup = store.get_or_compute
        store.get_or_compute = lambda _, *rest: lookup(key, *rest)  # type: ignore[method-assign]
        features = FeatureCache(store).get_or_compute(FRAME, "", lambda: Sift().extract(FRAME[:, :, 1].copy(), 8))
        assert len(features) <= 100


def picture(path: Path) -> None:
    with tempfile.TemporaryDirectory() as folder:
        shutil.copy(path, Path(folder) / path.name)
        assert all(frame.image.ndim == 3 for frame in ImageFolder(folder))


def video(path: Path) -> None:
    assert all(frame.image.ndim == 3 for frame in VideoFile(path))


READERS: dict[str, Callable[[Path], None]] = {
    "checkpoint": checkpoint,
    "regions": regions,
    "labels": labels,
    "cache": cache,
    "picture": picture,
    "video": video,
}


def outcome(read: Callable[[Path], None], path: Path) -> str:
    signal.alarm(SECONDS)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            read(path)
    except InputError as error:
        return "refused" if len(str(error)) < 2000 else f"a message of {len(str(error))} characters"
    except Exception as error:
        return f"{type(error).__name__}: {error}"
    finally:
        signal.alarm(0)
    return "read"


def peak_mb() -> float:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def main() -> None:
    read = READERS[sys.argv[1]]
    Skill.load(sys.argv[2]).infer(FRAME)  # imports and allocates what reading needs anyway
    mapped = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (mapped + MEMORY_BYTES,) * 2)
    before = peak_mb()
    for name in sys.argv[3:]:
        began = time.monotonic()
        ended = outcome(read, Path(name))
        line = {"name": name, "ended": ended, "seconds": time.monotonic() - began, "mb": peak_mb() - before}
        print(json.dumps(line), flush=True)


if __name__ == "__main__":
    main()
