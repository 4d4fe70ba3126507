"""A small study, and a cluster of one node to run it on."""

import json
import os
import shutil
import socket
import subprocess
import time
from collections.abc import Iterator, Sequence
from pathlib import Path

import pytest

DAEMONS = ("munged", "slurmctld", "slurmd")


@pytest.fixture
def study_file(tiny: Sequence[str], demonstration_folder: Path, tmp_path: Path) -> Path:
    """The configuration folder of a study ``tiny`` of two labeled copies of the synthetic demonstration."""
    data = tmp_path / "data"
    square = [[100, 40], [150, 40], [150, 90], [100, 90]]
    labels = {"object": [[20, 40], [60, 40], [60, 90], [20, 90]], "target": square, "hand": []}
    for name in ("human1", "robot1"):
        shutil.copytree(demonstration_folder, data / name)
        regions = {"image_size": [160, 120], "frames": {"0": labels, "19": labels}}
        (data / f"{name}.regions.json").write_text(json.dumps(regions))
    overrides = [override for override in tiny if not override.startswith(("task", "logger", "threads"))]
    study = {
        "name": "tiny",
        "data": str(data),
        "train": ["task=video", "task.path=${artifact.data}/human1", *overrides],
        "test_sets": {
            name: [f"video=${{artifact.data}}/{name}", f"regions=${{artifact.data}}/{name}.regions.json"]
            for name in ("human1", "robot1")
        },
        "every": 5,
        "seeds": [3, 4],
        "variants": {"default": [], "sigma0=1": ["objective.sigma0=1.0"]},
        "published": {"default": {"human1": 50.0}},
    }
    (tmp_path / "conf" / "artifact").mkdir(parents=True)
    (tmp_path / "conf" / "artifact" / "tiny.yaml").write_text(json.dumps(study))
    return tmp_path / "conf"


@pytest.fixture(scope="session")
def slurm(tmp_path_factory: pytest.TempPathFactory) -> Iterator[dict[str, str]]:
    """What the environment of a command needs for a Slurm of this machine alone, with its daemons, and with preemption.

    A job in the partition ``high`` takes the place of those in ``low``, which are requeued.
    """
    missing = [name for name in DAEMONS if shutil.which(name) is None]
    if missing or os.geteuid() != 0:
        pytest.skip(f"no Slurm: {', '.join(missing) or 'its daemons need root'}; expected Debian's slurm-wlm and munge")
    folder = tmp_path_factory.mktemp("slurm")
    for name in ("state", "spool"):
        (folder / name).mkdir()
    (folder / "munge.key").write_bytes(os.urandom(1024))
    (folder / "munge.key").chmod(0o600)
    ports = [_free_port(), _free_port()]
    (folder / "slurm.conf").write_text(CONFIGURATION.format(folder=folder, ports=ports, host=socket.gethostname()))
    environment = {"SLURM_CONF": str(folder / "slurm.conf")}
    munge = [f"--{name}-file={folder / name}" for name in ("pid", "log", "seed")]
    commands = {
        "munged": [
            "munged",
            "--foreground",
            "--force",
            f"--key-file={folder / 'munge.key'}",
            f"--socket={folder / 'socket'}",
            *munge,
        ],
        "slurmctld": ["slurmctld", "-D"],
        "slurmd": ["slurmd", "-D"],
    }
    running = []
    try:
        for name, command in commands.items():
            with (folder / f"{name}.out").open("w") as output:
                running.append(
                    subprocess.Popen(command, env={**os.environ, **environment}, stdout=output, stderr=output)
                )
            time.sleep(1)
        _wait_for_the_node({**os.environ, **environment}, folder)
        yield environment
    finally:
        for process in reversed(running):
            process.terminate()
            process.wait(timeout=60)


def _free_port() -> int:
    with socket.socket() as one:
        one.bind(("127.0.0.1", 0))
        return int(one.getsockname()[1])


def _wait_for_the_node(environment: dict[str, str], folder: Path) -> None:
    for _ in range(30):
        ended = subprocess.run(
            ["sinfo", "--noheader", "--format=%t"], env=environment, capture_output=True, text=True, check=False
        )
        if "idle" in ended.stdout:
            return
        time.sleep(1)
    said = " ".join(line for name in DAEMONS for line in (folder / f"{name}.out").read_text().splitlines()[-2:])
    pytest.skip(f"no Slurm: its daemons do not run here ({said}); expected a node that is idle")


CONFIGURATION = """
ClusterName=test
SlurmctldHost={host}(127.0.0.1)
SlurmUser=root
AuthType=auth/munge
CredType=cred/munge
# A requeued job waits as long as its credentials are valid.
AuthInfo=socket={folder}/socket,cred_expire=5
SlurmctldPort={ports[0]}
SlurmdPort={ports[1]}
StateSaveLocation={folder}/state
SlurmdSpoolDir={folder}/spool
SlurmctldPidFile={folder}/slurmctld.pid
SlurmdPidFile={folder}/slurmd.pid
# Containers have no cgroups of their own.
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
SwitchType=switch/none
MpiDefault=none
ReturnToService=2
SelectType=select/cons_tres
SelectTypeParameters=CR_CPU
SchedulerParameters=sched_interval=1,bf_interval=1
PreemptType=preempt/partition_prio
PreemptMode=REQUEUE
JobRequeue=1
KillWait=5
NodeName={host} NodeAddr=127.0.0.1 CPUs=2 State=UNKNOWN
PartitionName=low Nodes=ALL Default=YES MaxTime=1440 State=UP PriorityTier=1
PartitionName=high Nodes=ALL MaxTime=1440 State=UP PriorityTier=2
"""
