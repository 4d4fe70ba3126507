"""The commands as processes: what only a real one shows."""

import csv
import os
import resource
import shlex
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import pytest
from hydra.errors import ConfigCompositionException

from geoskill.cli.command import explain
from geoskill.errors import InputError

Command = Callable[..., Any]

ROOT = Path(__file__).resolve().parents[2]


@pytest.mark.parametrize("name", ["train", "infer", "evaluate"])
def test_help_answers_at_once(environment: dict[str, str], name: str) -> None:
    program = (
        f"import sys, runpy; sys.argv = ['{name}.py', '--help']\n"
        f"try: runpy.run_path('{name}.py', run_name='__main__')\n"
        "except SystemExit: pass\n"
        "heavy = {'torch', 'lightning', 'torch_geometric', 'cv2', 'matplotlib', 'wandb'} & sys.modules.keys()\n"
        "print('heavy:', sorted(heavy))"
    )
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    ended = subprocess.run(
        [sys.executable, "-c", program], cwd=ROOT, env=environment, capture_output=True, text=True, check=True
    )
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    # Time at work, which other programs do not lengthen.
    assert after.ru_utime - before.ru_utime + after.ru_stime - before.ru_stime < 3
    assert "== Config ==" in ended.stdout
    assert ended.stdout.splitlines()[-1] == "heavy: []"


def test_explained_causes() -> None:
    wrapped = RuntimeError("while building")
    wrapped.__cause__ = InputError("model.layers=0: expected\nat least 1")
    assert explain(wrapped) == (2, "model.layers=0: expected at least 1")
    full = OSError(28, "No space left on device", "/run/skill.ckpt")
    assert explain(full) == (1, "/run/skill.ckpt: no space left on the disk; nothing that was complete is lost")
    assert explain(OSError(13, "Permission denied", "/run"))[0] == 1
    status, message = explain(ConfigCompositionException("Could not override 'see'.\nTo append to your config use +"))
    assert (status, message.splitlines()) == (2, [message])
    assert "'see'" in message
    assert explain(ZeroDivisionError("x")) == (1, "ZeroDivisionError: x (debug=true shows where)")


def wait_for_epochs(folder: Path, epochs: int, process: "subprocess.Popen[str]") -> None:
    for _ in range(6000):
        if (folder / "metrics.csv").is_file():
            with (folder / "metrics.csv").open(newline="") as file:
                if len({row["epoch"] for row in csv.DictReader(file)}) >= epochs:
                    return
        assert process.poll() is None, process.communicate()
        time.sleep(0.1)
    raise AssertionError(f"no {epochs} epochs in ten minutes")


@pytest.mark.slow
def test_ctrl_c_says_how_to_go_on_and_that_works(
    environment: dict[str, str], tiny: Sequence[str], tmp_path: Path
) -> None:
    run = tmp_path / "a run"  # a space, which the shown command must quote
    many = "trainer.max_epochs=100000", "early_stopping.patience=null", "descriptor=[sift,lbd]"
    process = subprocess.Popen(
        [sys.executable, "train.py", *tiny, *many, f"hydra.run.dir={run}"],
        cwd=ROOT,
        env=environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        # A shell starts what it runs in the background with SIGINT ignored, and a test run would hand that on.
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    )
    try:
        wait_for_epochs(run, 1, process)
        process.send_signal(signal.SIGINT)
        _, stderr = process.communicate(timeout=120)
    finally:
        process.kill()
        process.wait()
    assert process.returncode == 130
    lines = stderr.strip().splitlines()
    assert lines[0].startswith("interrupted after ")
    assert f"{run / 'skill.ckpt'} is complete" in lines[0]
    assert len(lines) == 2
    assert not (run / "associations.jsonl").exists()

    epochs = int(lines[0].split()[2])
    shown = shlex.split(lines[1])
    assert shown[:2] == ["python", "train.py"]
    assert f"ckpt_path={run / 'skill.ckpt'}" in shown
    resumed = tmp_path / "resumed"
    # The number of epochs would keep the test waiting; what is given last counts.
    ended = subprocess.run(
        [sys.executable, *shown[1:], f"trainer.max_epochs={epochs + 2}", f"hydra.run.dir={resumed}"],
        cwd=ROOT,
        env=environment,
        capture_output=True,
        text=True,
        timeout=600,
        check=False,
    )
    assert ended.returncode == 0, ended.stderr
    with (resumed / "metrics.csv").open(newline="") as file:
        steps = [int(row["step"]) for row in csv.DictReader(file)]
    assert steps == list(range(1, steps[-1] + 1))
    assert 3 * epochs <= steps[-1] <= 3 * (epochs + 2)
    assert (resumed / "associations.jsonl").is_file()


@pytest.mark.slow
def test_wandb_is_offline_and_asks_nobody(
    environment: dict[str, str], script: Command, tiny: Sequence[str], tmp_path: Path
) -> None:
    ended = script(
        "train",
        *(override for override in tiny if override != "logger=none"),
        f"hydra.run.dir={tmp_path}",
        stdin=subprocess.DEVNULL,
    )
    assert (ended.status, ended.folder) == (0, tmp_path), ended.stderr
    assert ended.stderr == ""
    runs = list((tmp_path / "wandb").glob("offline-run-*"))
    assert len(runs) == 1
    assert list(runs[0].glob("*.wandb"))
    assert not list((tmp_path / "wandb").glob("run-*"))
    assert not (Path(environment["HOME"]) / ".netrc").exists()
    assert "login" not in ended.stdout.lower()
    assert not (ROOT / "wandb").exists()


@pytest.mark.slow
def test_from_another_folder(environment: dict[str, str], tiny: Sequence[str], tmp_path: Path) -> None:
    ended = subprocess.run(
        [sys.executable, "-m", "geoskill.cli.train", *tiny],
        cwd=tmp_path,
        env={**environment, "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert ended.returncode == 0, ended.stderr
    folder = Path(ended.stdout.strip().splitlines()[-1])
    assert folder.is_relative_to(tmp_path / "outputs" / "train")
    assert (folder / "skill.ckpt").is_file()
    assert os.listdir(tmp_path) == ["outputs"]
