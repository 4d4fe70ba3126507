"""Two commands do not write into one folder."""

import os
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import pytest

from geoskill.io.lock import LOCK, locked

Command = Callable[..., Any]


def contents(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


@pytest.mark.parametrize("name", ["train", "infer", "evaluate", "reproduce"])
def test_second_command_in_a_folder_is_refused_and_changes_nothing(command: Command, tmp_path: Path, name: str) -> None:
    (tmp_path / ".hydra").mkdir()
    (tmp_path / ".hydra" / "overrides.yaml").write_text("- seed=1\n")
    (tmp_path / "metrics.json").write_text("{}")
    with locked(tmp_path):
        before = contents(tmp_path)
        ended = command(name, f"hydra.run.dir={tmp_path}")
        assert ended.status == 2
        assert ended.stderr.startswith(f"error: {tmp_path}: is being written by process {os.getpid()} on ")
        assert len(ended.stderr.splitlines()) == 1
        assert contents(tmp_path) == before


def test_second_sweep_in_a_folder_is_refused(command: Command, tiny: Sequence[str], tmp_path: Path) -> None:
    with locked(tmp_path):
        ended = command("train", "-m", *tiny, "seed=0,1", f"hydra.sweep.dir={tmp_path}")
        assert ended.status == 2
        assert ended.stderr.startswith(f"error: {tmp_path}: is being written by process {os.getpid()} on ")
        assert [path.name for path in tmp_path.iterdir()] == [LOCK]


def test_folder_is_free_after_a_command_and_without_leftovers(command: Command, tmp_path: Path) -> None:
    run = tmp_path / "run"
    run.mkdir()
    (run / ".skill.1-2.part.ckpt").write_text("half")
    for _ in range(2):
        ended = command("infer", "skill=no.ckpt", "video=none", f"hydra.run.dir={run}")
        assert (ended.status, "no.ckpt: no such file" in ended.stderr) == (2, True)
    assert [path.name for path in run.iterdir()] == [".hydra"]


def test_folder_that_cannot_be_made(command: Command, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("no folder")
    for folder in (tmp_path / "file", tmp_path / "file" / "run", Path("/proc/run")):
        ended = command("infer", "skill=no.ckpt", "video=none", f"hydra.run.dir={folder}")
        assert ended.status == 2
        assert ended.stderr.startswith(f"error: {folder}: cannot be written (")
        assert ended.stderr.endswith("); expected a folder that can be\n")
