"""Who starts the processes of a training, and who requeues it, inside a job of Slurm."""

import os
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
import pytest
from lightning.fabric.plugins.environments.lightning import LightningEnvironment
from lightning.fabric.plugins.environments.slurm import SLURMEnvironment

from geoskill.config import TrainConfig
from geoskill.training.trainer import cluster_environment
from tests.training.conftest import Learn


@pytest.mark.parametrize(
    ("job", "expected"),
    [
        ({}, type(None)),
        ({"SLURM_JOB_ID": "7"}, LightningEnvironment),
        ({"SLURM_JOB_ID": "7", "SLURM_NTASKS": "1"}, LightningEnvironment),
        ({"SLURM_JOB_ID": "7", "SLURM_NTASKS": "2", "SLURM_NTASKS_PER_NODE": "2"}, SLURMEnvironment),
    ],
)
def test_who_starts_the_processes(monkeypatch: pytest.MonkeyPatch, job: Mapping[str, str], expected: type) -> None:
    for name in ("SLURM_JOB_ID", "SLURM_NTASKS"):
        monkeypatch.delenv(name, raising=False)
    for name, value in job.items():
        monkeypatch.setenv(name, value)
    environment = cluster_environment()
    assert type(environment) is expected
    assert not (isinstance(environment, SLURMEnvironment) and environment.auto_requeue)


def test_training_in_a_job_is_the_same_and_silent(
    learn_unchecked: Learn,
    configured: Callable[..., TrainConfig],
    pictures: np.ndarray,
    monkeypatch: pytest.MonkeyPatch,
    tmp_path: Path,
) -> None:
    (tmp_path / "srun").write_text("#!/bin/sh\n")
    (tmp_path / "srun").chmod(0o755)
    monkeypatch.setenv("PATH", str(tmp_path), prepend=os.pathsep)  # Lightning warns where it finds it
    outside = learn_unchecked(configured(epochs=1), pictures)
    monkeypatch.setenv("SLURM_JOB_ID", "7")
    monkeypatch.setenv("SLURM_NTASKS", "1")
    inside = learn_unchecked(configured(epochs=1), pictures)  # a warning would be an error
    assert inside.curves == outside.curves
