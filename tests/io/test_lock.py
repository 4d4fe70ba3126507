"""A folder is one process's at a time, and free again however that process ends."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import pairwise
from pathlib import Path

import pytest

from geoskill.errors import InputError
from geoskill.io.lock import LOCK, locked

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="there are no such locks")


@contextmanager
def held_by_another_process(folder: Path) -> Iterator[subprocess.Popen[str]]:
    program = (
        "import sys, pathlib\nfrom geoskill.io.lock import locked\n"
        "with locked(pathlib.Path(sys.argv[1])): print('held', flush=True); sys.stdin.read()"
    )
    environment = {**os.environ, "PYTHONPATH": ":".join(sys.path)}
    command = [sys.executable, "-c", program, str(folder)]
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE}
    with subprocess.Popen(command, env=environment, text=True, **pipes) as process:  # type: ignore[call-overload]
        assert process.stdout.readline() == "held\n"
        yield process
        process.stdin.close()


def test_another_process_is_refused_and_told_who_has_it(tmp_path: Path) -> None:
    with held_by_another_process(tmp_path) as process:
        message = rf"^{tmp_path}: is being written by process {process.pid} on \S+, since 20.+; expected another folder"
        for _ in range(2):
            with pytest.raises(InputError, match=message), locked(tmp_path):
                pass
    with locked(tmp_path):
        assert (tmp_path / LOCK).read_text().startswith(f"process {os.getpid()} on ")
    assert list(tmp_path.iterdir()) == []


def test_folder_is_free_after_a_failure_and_held_against_the_same_process(tmp_path: Path) -> None:
    with pytest.raises(ZeroDivisionError), locked(tmp_path):
        with pytest.raises(InputError, match=f"process {os.getpid()} on"), locked(tmp_path):
            pass
        raise ZeroDivisionError
    with locked(tmp_path), locked(tmp_path.parent):
        pass


def test_what_a_killed_process_left_is_removed(tmp_path: Path) -> None:
    (tmp_path / "skill.ckpt").write_text("complete")
    (tmp_path / "notes.part.txt").write_text("of the user")
    (tmp_path / ".hydra").mkdir()
    with held_by_another_process(tmp_path) as process:
        (tmp_path / ".skill.123-456.part.ckpt").write_text("half")
        process.send_signal(signal.SIGKILL)
        process.wait()
    assert (tmp_path / LOCK).exists()
    with locked(tmp_path):
        assert sorted(path.name for path in tmp_path.iterdir()) == [".hydra", LOCK, "notes.part.txt", "skill.ckpt"]


def test_missing_folder(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError), locked(tmp_path / "none"):
        pass


@pytest.mark.slow
def test_of_many_processes_one_at_a_time_has_the_folder(tmp_path: Path) -> None:
    """Each notes when it came and went, again and again; no two intervals overlap."""
    folder = tmp_path / "run"
    folder.mkdir()
    program = (
        "import sys, time, pathlib\nfrom geoskill.io.lock import locked\nfrom geoskill.errors import InputError\n"
        "folder, end = pathlib.Path(sys.argv[1]), time.monotonic() + 2\n"
        "while time.monotonic() < end:\n"
        "    try:\n"
        "        with locked(folder):\n"
        "            came = time.monotonic_ns(); time.sleep(0.002); print(came, time.monotonic_ns())\n"
        "    except InputError: pass\n"
    )
    environment = {**os.environ, "PYTHONPATH": ":".join(sys.path)}
    command = [sys.executable, "-c", program, str(folder)]
    processes = [subprocess.Popen(command, env=environment, text=True, stdout=subprocess.PIPE) for _ in range(4)]
    intervals = []
    for process in processes:
        output, _ = process.communicate(timeout=60)
        assert process.returncode == 0
        intervals += [tuple(map(int, line.split())) for line in output.splitlines()]
    intervals.sort()
    assert len(intervals) > 20
    assert all(before[1] <= after[0] for before, after in pairwise(intervals))
    assert list(folder.iterdir()) == []
    assert time.monotonic_ns() > intervals[-1][1]
