"""Studies and trainings as jobs of a real Slurm, preempted again and again."""

import json
import os
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path

import pytest
import torch

from tests.command_runs import ROOT, Command

pytestmark = pytest.mark.slow

LONG = ("trainer.max_epochs=100",)
"""As many epochs as leave the time to preempt a training in."""


class Cluster:
    """Slurm's commands, with their output."""

    def __init__(self, environment: dict[str, str]) -> None:
        self.environment = environment

    def __call__(self, *command: str) -> str:
        ended = subprocess.run(
            command, env=self.environment, cwd=ROOT, capture_output=True, text=True, check=False, timeout=60
        )
        assert ended.returncode == 0, (command, ended.stderr)
        return ended.stdout

    def running(self) -> list[str]:
        """Return the numbers of running jobs of the partition ``low``."""
        return self("squeue", "--noheader", "--array", "--format=%A", "--partition=low", "--states=R").split()

    def restarts(self, job: str) -> int:
        described = self("scontrol", "show", "job", job)
        return int(described.partition("Restarts=")[2].split()[0])


@pytest.fixture
def cluster(slurm: dict[str, str], environment: dict[str, str]) -> Cluster:
    return Cluster({**environment, **slurm})


def wait_for(condition: Callable[[], bool], seconds: float, what: str) -> None:
    deadline = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < deadline, f"{what}: not within {seconds:g} s"
        time.sleep(0.5)


def preempt(cluster: Cluster, number: int) -> None:
    """Take its place from a running job, in one of three ways, and wait until it is taken."""
    job = cluster.running()[0]
    before = cluster.restarts(job)
    if number % 3 == 0:
        cluster("scontrol", "requeue", job)
    elif number % 3 == 1:
        cluster("sbatch", "--partition=high", "--exclusive", "--output=/dev/null", "--wrap=sleep 1")
    else:  # what Slurm sends some time before the end of a job's time, or before preemption
        cluster("scancel", "--signal=USR2", job)
    wait_for(lambda: cluster.restarts(job) > before, 60, f"preemption {number}")


def test_preempted_study_has_the_results_of_an_unbroken_one(
    cluster: Cluster, script: Command, study_file: Path, tmp_path: Path
) -> None:
    rounds = 10 if int(os.environ.get("ROBUSTNESS_ROUNDS", "100")) >= 1000 else 3
    path = study_file / "artifact" / "tiny.yaml"
    study = json.loads(path.read_text())
    study |= {"train": [*study["train"], *LONG], "seeds": [3]}
    del study["test_sets"]["human1"]
    path.write_text(json.dumps(study))
    arguments = ["--config-dir", str(study_file), "artifact=tiny", "report=false"]
    unbroken, preempted = tmp_path / "unbroken", tmp_path / "preempted"
    ended = script("reproduce", *arguments, "hydra/launcher=basic", f"hydra.run.dir={unbroken}")
    assert (ended.status, ended.stderr) == (0, "")

    # One job at a time, so that it is this one that has written its steps.
    launcher = ["hydra/launcher=submitit_slurm", "hydra.launcher.partition=low", "hydra.launcher.array_parallelism=1"]
    command = [sys.executable, "reproduce.py", *arguments, *launcher, f"hydra.run.dir={preempted}"]
    with (tmp_path / "output").open("w") as output:
        running = subprocess.Popen(command, cwd=ROOT, env=cluster.environment, stdout=output, stderr=output)
    try:
        known = 0
        for number in range(rounds):
            # Of a job that trains; one that has just begun does not have the handler of signals yet.
            wait_for(lambda known=known: rows(preempted) > known and len(cluster.running()) > 0, 120, f"step {known}")
            preempt(cluster, number)
            known = rows(preempted)
        assert running.wait(timeout=400) == 0, (tmp_path / "output").read_text()
    finally:
        running.kill()
        cluster("scancel", "--user=root")
    for name in ("default", "sigma0-1"):
        ours, theirs = preempted / "full" / name / "3", unbroken / "full" / name / "3"
        assert (ours / "metrics.csv").read_bytes() == (theirs / "metrics.csv").read_bytes()
        assert same_weights(ours, theirs)
    assert (preempted / "full" / "table.md").read_bytes() == (unbroken / "full" / "table.md").read_bytes()


def rows(study: Path) -> int:
    """Return how many steps the trainings of a study have written down."""
    return sum(len(path.read_text().splitlines()) - 1 for path in study.glob("full/*/*/metrics.csv"))


def same_weights(first: Path, second: Path) -> bool:
    ours, theirs = (torch.load(run / "skill.ckpt", weights_only=True)["state_dict"] for run in (first, second))
    return ours.keys() == theirs.keys() and all(torch.equal(ours[name], theirs[name]) for name in ours)


def test_batch_script_of_the_documentation_requeues_itself(
    cluster: Cluster, tiny: Sequence[str], tmp_path: Path
) -> None:
    """Its step gets SIGTERM, as some time before the end of its time; it goes on, and all steps are there once."""
    page = (ROOT / "docs" / "usage" / "clusters.md").read_text()
    script = page.partition("```bash\n")[2].partition("```")[0]
    given = [setting for setting in tiny if not setting.startswith("trainer.max_epochs")]
    run = tmp_path / "outputs" / "train"
    for name, value in (
        ("python train.py", f"{sys.executable} train.py {' '.join([*LONG, *given])}"),
        (" task=video task.path=demo.mp4", ""),
        ("outputs/train/$SLURM_JOB_ID", f"{run}/$SLURM_JOB_ID"),
        ("%j.log", f"{tmp_path}/%j.log"),
        ("--cpus-per-task=2", "--cpus-per-task=1"),
    ):
        assert name in script
        script = script.replace(name, value)
    (tmp_path / "job.sh").write_text(script)
    job = cluster("sbatch", "--parsable", str(tmp_path / "job.sh")).strip()
    curves = run / job / "metrics.csv"
    try:
        wait_for(curves.exists, 120, "the first epoch")
        cluster("scancel", "--signal=TERM", job)
        wait_for(lambda: cluster.restarts(job) == 1, 60, "the requeue")
        wait_for((run / job / "metrics.json").exists, 240, "the end")
    finally:
        cluster("scancel", "--user=root")
    log = (tmp_path / f"{job}.log").read_text()
    assert "interrupted after" in log, log
    steps = [int(line.partition(",")[0]) for line in curves.read_text().splitlines()[1:]]
    assert steps == list(range(1, 301))
