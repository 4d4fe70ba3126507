"""The command ``python -m geoskill.benchmarks.waiting``, on a small demonstration and on bad input."""

import json
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

import pytest

from geoskill.benchmarks.waiting import timed
from geoskill.errors import InputError

TINY = (
    "model=bilinear",
    "features.min_side=0",
    "features.max_features=20",
    "trainer.max_epochs=1",
    "trainer.limit_train_batches=2",
)


def run(arguments: Sequence[str], folder: Path) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "geoskill.benchmarks.waiting", *arguments, f"hydra.run.dir={folder}"]
    return subprocess.run(command, capture_output=True, text=True, check=False)


@pytest.mark.slow
def test_waiting_writes_table_and_json(demonstration_folder: Path, tmp_path: Path) -> None:
    ended = run(
        [f"video={demonstration_folder}", f"overrides=[{','.join(map(repr, TINY))}]", "repeats=2", "frames=5"], tmp_path
    )
    assert ended.returncode == 0, ended.stderr
    content = json.loads((tmp_path / "waiting.json").read_text())
    rows = {row["what"]: row for row in content["rows"]}
    assert list(rows) == [
        "the whole command, 1 thread",
        "the whole command, 2 threads",
        "train --help",
        "import geoskill",
        "Skill.load",
        "selection of a live frame, 1 thread",
    ]
    assert all(len(row["seconds"]) == 2 and min(row["seconds"]) > 0 for row in rows.values())
    assert [row["clock"] for row in rows.values()] == ["processor", "wall", *["processor"] * 4]
    assert max(rows["import geoskill"]["seconds"]) < min(rows["Skill.load"]["seconds"])
    assert (tmp_path / "waiting.md").read_text() in ended.stdout
    assert not (tmp_path / "waiting.png").exists()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ([], "error: video is not set; expected a demonstration (video=…)"),
        (["video=/no/such.mp4"], "error: '/no/such.mp4' does not exist"),
        (["video=.", "repeats=0"], "error: repeats=0: expected a whole number of at least 1"),
    ],
)
def test_waiting_refuses_bad_input(tmp_path: Path, arguments: Sequence[str], message: str) -> None:
    ended = run(arguments, tmp_path)
    assert (ended.returncode, ended.stderr.count("\n")) == (2, 1)
    assert ended.stderr.startswith(message)
    assert not (tmp_path / "waiting.json").exists()


def test_timed_counts_the_work_of_the_program_only() -> None:
    busy, idle = timed(["-c", "sum(range(10**7))"]), timed(["-c", "import time; time.sleep(0.5)"])
    assert busy[0] > idle[0]
    assert idle[1] >= 0.5 > idle[0]


def test_timed_tells_what_a_failed_program_said() -> None:
    with pytest.raises(InputError, match="-c 1 / 0: ZeroDivisionError: division by zero"):
        timed(["-c", "1 / 0"])
