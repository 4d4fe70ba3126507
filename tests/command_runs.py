"""The commands as tests call them: within this process, which is quick, or as a process of their own."""

import os
import subprocess
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import pytest
from hydra.core.global_hydra import GlobalHydra

ROOT = Path(__file__).resolve().parents[1]


@dataclass(frozen=True)
class Ended:
    """How a command ended."""

    status: int
    stdout: str
    stderr: str

    @property
    def folder(self) -> Path:
        """What the last line on standard output names."""
        return Path(self.stdout.strip().splitlines()[-1])


Command = Callable[..., Ended]


@pytest.fixture(scope="session")
def environment(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """Of the commands: an own cache, one thread, nobody who is logged in anywhere."""
    home = tmp_path_factory.mktemp("home")
    kept = {name: value for name, value in os.environ.items() if not name.startswith(("WANDB_", "HYDRA_"))}
    return {**kept, "HOME": str(home), "XDG_CACHE_HOME": str(home / "cache"), "OMP_NUM_THREADS": "1"}


@pytest.fixture(scope="session")
def python(environment: dict[str, str]) -> Callable[..., "subprocess.CompletedProcess[str]"]:
    """``python("-c", PROGRAM)`` runs the interpreter with these arguments from the repository's root."""

    def run(*arguments: str, **settings: object) -> "subprocess.CompletedProcess[str]":
        ended: subprocess.CompletedProcess[str] = subprocess.run(  # type: ignore[call-overload]
            [sys.executable, *arguments],
            cwd=ROOT,
            env=environment,
            capture_output=True,
            text=True,
            timeout=600,
            check=False,
            **settings,
        )
        return ended

    return run


@pytest.fixture(scope="session")
def script(python: Callable[..., "subprocess.CompletedProcess[str]"]) -> Command:
    """``script("train", "seed=1")`` runs ``python train.py seed=1`` from the repository's root."""

    def run(name: str, *arguments: str, **settings: object) -> Ended:
        ended = python(f"{name}.py", *arguments, **settings)
        return Ended(ended.returncode, ended.stdout, ended.stderr)

    return run


@pytest.fixture
def command(
    environment: dict[str, str], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> Command:
    """``command("train", "seed=1")`` does what ``python train.py seed=1`` does, within this process."""
    from geoskill.cli import evaluate, infer, reproduce, serve, servo, train

    mains = {
        "train": train.main,
        "infer": infer.main,
        "evaluate": evaluate.main,
        "reproduce": reproduce.main,
        "servo": servo.main,
        "serve": serve.main,
    }
    for name in ("HOME", "XDG_CACHE_HOME"):
        monkeypatch.setenv(name, environment[name])
    for name in ("HYDRA_FULL_ERROR", "WANDB_SILENT"):  # the commands set them; what is set here ends with the test
        monkeypatch.setenv(name, "1")
    monkeypatch.setenv("OMP_WAIT_POLICY", "PASSIVE")
    monkeypatch.chdir(ROOT)

    def run(name: str, *arguments: str) -> Ended:
        # A page takes as long as all the rest; who wants one says so.
        quiet = [] if any(own.startswith("report=") for own in arguments) else ["report=false"]
        monkeypatch.setattr(sys, "argv", [f"{name}.py", *arguments, *(quiet if name in ("infer", "evaluate") else [])])
        GlobalHydra.instance().clear()
        capsys.readouterr()
        status = 0
        try:
            mains[name]()
        except SystemExit as ending:
            status = ending.code if isinstance(ending.code, int) else 1
        captured = capsys.readouterr()
        return Ended(status, captured.out, captured.err)

    return run


@pytest.fixture(scope="session")
def tiny(demonstration_folder: Path) -> Sequence[str]:
    """Overrides that make a training of the synthetic demonstration last a second."""
    return (
        "task=video",
        f"task.path={demonstration_folder}",
        "model=bilinear",
        "model.hidden_dim=8",
        "logger=none",
        "threads=1",
        "features.min_side=0",
        "features.max_features=20",
        "demonstration.max_span_ratio=0",
        "trainer.max_epochs=2",
        "trainer.limit_train_batches=3",
        "inference.abstain=0",  # it learns nothing in six steps, and says so
        "report=false",
    )


@pytest.fixture(scope="session")
def trained(script: Command, tiny: Sequence[str], tmp_path_factory: pytest.TempPathFactory) -> Ended:
    """A training as a user runs it; its folder is read only."""
    folder = tmp_path_factory.mktemp("trained") / "run"
    ended = script("train", *tiny, f"hydra.run.dir={folder}")
    assert ended.status == 0, ended.stderr
    return ended


@pytest.fixture(scope="session")
def skill(trained: Ended) -> Path:
    """The checkpoint of that training."""
    return trained.folder / "skill.ckpt"
