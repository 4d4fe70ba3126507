"""The commands as processes: help, Ctrl-C, kill, wandb and other folders."""

import csv
import errno
import json
import os
import pwd
import resource
import shlex
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import warnings
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any
from unittest.mock import Mock

import pytest
import torch
from hydra.core.global_hydra import GlobalHydra
from hydra.core.hydra_config import HydraConfig
from hydra.errors import ConfigCompositionException

from geoskill.cli.command import explain, give_libraries_a_home
from geoskill.errors import InputError
from geoskill.skill.checkpoint import read_skill
from geoskill.skill.skill import Skill

Command = Callable[..., Any]

ROOT = Path(__file__).resolve().parents[2]


@pytest.mark.slow
@pytest.mark.parametrize("name", ["train", "infer", "evaluate"])
def test_help_is_quick_and_imports_nothing_heavy(environment: dict[str, str], name: str) -> None:
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
    assert ended.stdout.startswith(f"python {name}.py [KEY=VALUE ...]\n")
    assert ended.stdout.splitlines()[-1] == "heavy: []"


@pytest.mark.slow
@pytest.mark.parametrize("wanted", [None, "ACTIVE"])
def test_idle_threads_sleep_in_every_command(environment: dict[str, str], tmp_path: Path, wanted: str | None) -> None:
    """The library that PyTorch divides its work with says how often a waiting thread looks before it sleeps."""
    program = (
        "import sys\n"
        "from geoskill.cli.command import run_command\n"
        "from geoskill.cli.schemas import InferCommandConfig\n"
        "assert 'torch' not in sys.modules\n"
        f"sys.argv[1:] = ['hydra.run.dir={tmp_path}']\n"
        "def job(config, run): import torch\n"
        "run_command('infer', InferCommandConfig, job)\n"
    )
    own = {name: value for name, value in environment.items() if name not in ("OMP_WAIT_POLICY", "GOMP_SPINCOUNT")}
    own |= {"OMP_DISPLAY_ENV": "verbose", **({} if wanted is None else {"OMP_WAIT_POLICY": wanted})}
    ended = subprocess.run(
        [sys.executable, "-c", program], cwd=ROOT, env=own, capture_output=True, text=True, check=True
    )
    spins = [int(line.split("'")[1]) for line in ended.stderr.splitlines() if "GOMP_SPINCOUNT" in line]
    if not spins:
        pytest.skip("this PyTorch does not divide its work with GNU OpenMP")
    assert (max(spins) == 0) == (wanted is None)


def test_explain() -> None:
    wrapped = RuntimeError("while building")
    wrapped.__cause__ = InputError("model.layers=0: expected\nat least 1")
    assert explain(wrapped, "train") == (2, "model.layers=0: expected at least 1")
    full = OSError(28, "No space left on device", "/run/skill.ckpt")
    assert explain(full, "train") == (
        1,
        "/run/skill.ckpt: no space left on the disk; nothing that was complete is lost",
    )
    assert explain(OSError(13, "Permission denied", "/run"), "train")[0] == 1
    status, message = explain(
        ConfigCompositionException("Could not override 'see'.\nTo append to your config use +"), "train"
    )
    assert (status, message.splitlines()) == (2, [message])
    assert "'see'" in message
    assert explain(ZeroDivisionError("x"), "train") == (1, "ZeroDivisionError: x (debug=true shows where)")


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
def test_ctrl_c_says_how_to_go_on(
    environment: dict[str, str],
    python: Command,
    tiny: Sequence[str],
    demonstration_folder: Path,
    tmp_path: Path,
) -> None:
    run = tmp_path / "Bob's run, (1)"  # which the shown command must quote for the shell
    video = tmp_path / "müller, [a].d"
    shutil.copytree(demonstration_folder, video)
    tiny = [override for override in tiny if not override.startswith("task.path=")] + [f"task.path={video}"]
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
    assert f"which are in {run / 'skill.ckpt'}" in lines[0]
    assert len(lines) == 2
    assert not (run / "associations.jsonl").exists()

    epochs = int(lines[0].split()[2])
    shown = shlex.split(lines[1])
    assert shown[:2] == [sys.executable, "train.py"]
    assert f"ckpt_path={run / 'skill.ckpt'}" in shown
    resumed = tmp_path / "resumed"
    # The number of epochs would keep the test waiting; what is given last counts.
    ended = python(*shown[1:], f"trainer.max_epochs={epochs + 2}", f"hydra.run.dir={resumed}")
    assert ended.returncode == 0, ended.stderr
    with (resumed / "metrics.csv").open(newline="") as file:
        steps = [int(row["step"]) for row in csv.DictReader(file)]
    assert steps == list(range(1, steps[-1] + 1))
    assert 3 * epochs <= steps[-1] <= 3 * (epochs + 2)
    assert (resumed / "associations.jsonl").is_file()


# Runs train.py, and kills the process in the last of so many calls of a function.
KILLED = """
import os, runpy, signal, sys
from importlib import import_module
module, owner, name, calls, when = sys.argv.pop(1).split(":")
owner = getattr(import_module(module), owner)
original, count = getattr(owner, name), 0

def counting(*arguments, **named):
    global count
    count += 1
    if count == int(calls) and when == "before":
        os.kill(os.getpid(), signal.SIGKILL)
    result = original(*arguments, **named)
    if count == int(calls):
        os.kill(os.getpid(), signal.SIGKILL)
    return result

setattr(owner, name, counting)
sys.argv[0] = "train.py"
runpy.run_path("train.py", run_name="__main__")
"""
CALLBACKS = "geoskill.training.callbacks"
# Of two epochs of three steps; the first checkpoint is written before any step.
MOMENTS = {
    "after the first checkpoint": (f"{CALLBACKS}:ResumableCheckpoint:_save:1:after", 0, False),
    "in the first epoch": (f"{CALLBACKS}:MetricsTable:on_train_batch_end:2:after", 0, False),
    "after the first epoch": (f"{CALLBACKS}:ResumableCheckpoint:_save:2:after", 1, False),
    "in the last epoch": (f"{CALLBACKS}:MetricsTable:on_train_batch_end:5:after", 1, False),
    "before the last checkpoint": (f"{CALLBACKS}:ResumableCheckpoint:_save:3:before", 1, False),
    "while the last checkpoint is written": ("lightning:Trainer:save_checkpoint:3:after", 1, False),
    "after the last checkpoint": (f"{CALLBACKS}:ResumableCheckpoint:_save:3:after", 2, True),
    "before the end of training": (f"{CALLBACKS}:SkillRecord:on_train_end:1:before", 2, True),
}


def same_weights(one: Path, other: Path) -> bool:
    ours, theirs = (torch.load(path, weights_only=True)["state_dict"] for path in (one, other))
    return ours.keys() == theirs.keys() and all(torch.equal(ours[key], theirs[key]) for key in ours)


@pytest.mark.slow
@pytest.mark.parametrize("moment", MOMENTS)
def test_killed_training_leaves_a_checkpoint_that_can_be_finished(
    python: Command,
    command: Command,
    tiny: Sequence[str],
    trained: Any,
    tmp_path: Path,
    moment: str,
) -> None:
    call, epochs, finished = MOMENTS[moment]
    run = tmp_path / "run"
    ended = python("-c", KILLED, call, *tiny, f"hydra.run.dir={run}")
    assert ended.returncode == -signal.SIGKILL, ended.stderr
    assert not (run / "associations.jsonl").exists()
    checkpoint = run / "skill.ckpt"
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        skill = Skill.load(checkpoint)
    assert (skill.provenance.finished, skill.provenance.epochs) == (finished, (epochs, 2))
    said = [str(warning.message) for warning in caught if "unfinished" in str(warning.message)]
    assert [f"({epochs} of 2 epochs)" in text and f"ckpt_path={checkpoint}" in text for text in said] == [True] * (
        not finished
    )
    assert same_weights(checkpoint, trained.folder / "skill.ckpt") == finished

    resumed = command("train", *tiny, f"ckpt_path={checkpoint}", f"hydra.run.dir={tmp_path / 'resumed'}")
    assert (resumed.status, resumed.stderr) == (0, "")
    assert same_weights(resumed.folder / "skill.ckpt", trained.folder / "skill.ckpt")  # the margin is one of them
    for name in ("associations.jsonl", "skill.yaml", "metrics.csv"):
        assert (resumed.folder / name).read_text() == (trained.folder / name).read_text(), name
    metrics = [json.loads((folder / "metrics.json").read_text()) for folder in (resumed.folder, trained.folder)]
    assert metrics[0] == metrics[1]
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert Skill.load(resumed.folder).provenance.finished


@pytest.mark.slow
def test_early_stopped_training_that_was_killed_is_finished_without_another_epoch(
    environment: dict[str, str], command: Command, tiny: Sequence[str], tmp_path: Path
) -> None:
    stopping = ["early_stopping.patience=0", "early_stopping.min_delta=1000", "trainer.max_epochs=5"]
    unbroken = command("train", *tiny, *stopping, f"hydra.run.dir={tmp_path / 'unbroken'}")
    assert unbroken.status == 0, unbroken.stderr
    run = tmp_path / "run"
    killed = subprocess.run(
        [
            sys.executable,
            "-c",
            KILLED,
            MOMENTS["after the last checkpoint"][0],
            *tiny,
            *stopping,
            f"hydra.run.dir={run}",
        ],
        cwd=ROOT,
        env=environment,
        timeout=600,
        check=False,
    )
    assert killed.returncode == -signal.SIGKILL
    assert read_skill(run).provenance.epochs == (2, 5)
    resumed = command("train", *tiny, *stopping, f"ckpt_path={run / 'skill.ckpt'}", f"hydra.run.dir={tmp_path / 'on'}")
    assert (resumed.status, resumed.stderr) == (0, "")
    assert same_weights(resumed.folder / "skill.ckpt", unbroken.folder / "skill.ckpt")
    assert (resumed.folder / "associations.jsonl").read_text() == (unbroken.folder / "associations.jsonl").read_text()


@pytest.mark.slow
def test_wandb_is_offline(environment: dict[str, str], script: Command, tiny: Sequence[str], tmp_path: Path) -> None:
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
def test_training_from_another_folder(environment: dict[str, str], tiny: Sequence[str], tmp_path: Path) -> None:
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


def test_user_without_a_home_gets_a_temporary_one(monkeypatch: pytest.MonkeyPatch) -> None:
    def no_entry(_: int) -> None:
        raise KeyError("uid not found")

    monkeypatch.setattr(pwd, "getpwuid", no_entry)
    monkeypatch.delenv("HOME")
    with pytest.raises(RuntimeError, match="home"):
        Path.home()
    give_libraries_a_home()
    assert Path.home() == Path(tempfile.gettempdir())


def test_home_of_the_user_stays(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("HOME", str(tmp_path))
    give_libraries_a_home()
    assert os.environ["HOME"] == str(tmp_path)


@pytest.mark.parametrize(
    ("free", "named"), [({"/run": 9e9, "/tmp/own": 0}, "/tmp/own"), ({"/run": 0, "/tmp/own": 9e9}, "where the run")]
)
def test_the_disk_that_is_full_is_named(monkeypatch: pytest.MonkeyPatch, free: dict[str, float], named: str) -> None:
    """A failed write does not say where it went."""
    monkeypatch.setattr("tempfile.gettempdir", lambda: "/tmp/own")
    monkeypatch.setattr("shutil.disk_usage", lambda place: Mock(free=free.get(place, free["/run"])))
    GlobalHydra.instance().clear()
    HydraConfig.instance().cfg = None
    status, message = explain(OSError(errno.ENOSPC, "No space left on device"), "train")
    assert status == 1
    assert message.startswith(named)
