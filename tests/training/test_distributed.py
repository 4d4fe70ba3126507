"""Training in two processes on one machine, as ``python train.py trainer=ddp`` starts them."""

import csv
import json
import os
import subprocess
import sys
from pathlib import Path

import cv2
import pytest
import torch

from geoskill.skill.skill import Skill

ROOT = Path(__file__).resolve().parents[2]


def train(demonstration: Path, *overrides: str, options: tuple[str, ...] = ()) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [
            sys.executable,
            str(ROOT / "train.py"),
            *options,
            "trainer=ddp",
            "model=bilinear",
            "logger=none",
            "task=video",
            f"task.path={demonstration}",
            "features.min_side=0",
            "features.max_features=10",
            "demonstration.max_span_ratio=0.6",
            "cache.enabled=false",
            "trainer.max_epochs=1",
            "trainer.enable_progress_bar=false",
            *overrides,
        ],
        capture_output=True,
        text=True,
        check=False,
        timeout=300,
        cwd=demonstration.parent,
        env={**os.environ, "PYTHONPATH": str(ROOT), "OMP_NUM_THREADS": "1"},
    )


@pytest.mark.slow
def test_ddp_in_two_processes_makes_one_run(demonstration_folder: Path, tmp_path: Path) -> None:
    run = tmp_path / "run"
    finished = train(demonstration_folder, f"hydra.run.dir={run}")
    assert (finished.returncode, finished.stdout.strip().splitlines()[-1]) == (0, str(run)), finished.stderr
    assert sorted(path.name for path in run.iterdir()) == [
        ".hydra",
        "associations.jsonl",
        "definition",
        "inference.png",
        "metrics.csv",
        "metrics.json",
        "overlay.mp4",
        "report.html",
        "skill.ckpt",
        "skill.yaml",
        "training.png",
    ]
    with (run / "metrics.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    # 46 transitions are 23 for each process, so three batches of at most 8; one process would take six.
    assert [row["step"] for row in rows] == ["1", "2", "3"]
    metrics = json.loads((run / "metrics.json").read_text())
    assert (metrics["steps"], metrics["frames"]) == (3, 20)
    assert "ddp_process" not in (run / ".hydra" / "hydra.yaml").read_text()

    skill = Skill.load(run / "skill.ckpt")
    frame = cv2.imread(str(demonstration_folder / "005.png"))[:, :, ::-1]
    assert len(skill.infer(frame).associations) == 10


@pytest.mark.slow
def test_sweep_refuses_several_processes(demonstration_folder: Path, tmp_path: Path) -> None:
    finished = train(demonstration_folder, "seed=0,1", f"hydra.sweep.dir={tmp_path}", options=("-m",))
    assert finished.returncode == 2
    assert "trainer.devices=2 in a sweep; expected one process for each of its runs" in finished.stderr
    assert not list(tmp_path.glob("*/skill.ckpt"))


@pytest.mark.slow
def test_two_processes_learn_what_one_does_with_the_same_transitions_a_step(
    demonstration_folder: Path, tmp_path: Path
) -> None:
    """Without random noise, of which each process has its own: equal but for the rounding of sums in another order."""
    exact = ["demonstration.descriptor_noise=0", "demonstration.feature_dropout=0", "trainer.max_epochs=2"]
    exact += ["demonstration.num_negatives=0", "report=false"]
    curves, weights = [], []
    for name, settings in (
        ("one", ["trainer=cpu", "demonstration.batch_size=8"]),
        ("two", ["demonstration.batch_size=4"]),
    ):
        finished = train(demonstration_folder, *exact, *settings, f"hydra.run.dir={tmp_path / name}")
        assert finished.returncode == 0, finished.stderr
        with (tmp_path / name / "metrics.csv").open(newline="") as file:
            curves.append([{key: float(value) for key, value in row.items()} for row in csv.DictReader(file)])
        weights.append(torch.load(tmp_path / name / "skill.ckpt", weights_only=True)["state_dict"])
    assert [len(rows) for rows in curves] == [12, 12]  # 46 transitions, 8 a step
    for one, two in zip(*curves, strict=True):
        assert two == pytest.approx(one, rel=1e-4, abs=1e-5)
    assert weights[0].keys() == weights[1].keys()
    for name, weight in weights[0].items():
        torch.testing.assert_close(weights[1][name], weight, rtol=1e-3, atol=1e-4, msg=name)
    first = torch.cat([w.flatten() for key, w in weights[0].items() if ".scorer." in key])
    assert float(first.std()) > 0
