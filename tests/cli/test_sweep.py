"""The summary of a sweep."""

import csv
import json
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import cv2
import pandas as pd
import pytest
import yaml
from omegaconf import OmegaConf

from geoskill.cli.command import FAILED_RUN
from geoskill.cli.sweep import SweepSummary, read_runs, write_summary

Command = Callable[..., Any]


def write_run(folder: Path, overrides: Sequence[str], metrics: Mapping[str, Any] | None) -> None:
    (folder / ".hydra").mkdir(parents=True)
    (folder / ".hydra" / "overrides.yaml").write_text(yaml.safe_dump(list(overrides)))
    if metrics is not None:
        (folder / "metrics.json").write_text(json.dumps(metrics))


def test_read_runs_in_job_order_with_what_was_swept(tmp_path: Path) -> None:
    for number in (10, 9, 2):
        write_run(tmp_path / str(number), [f"seed={number}", "kernel=p2p", f"+x='a={number}'"], {"steps": number})
    write_run(tmp_path / "3", ["seed=3"], None)  # stopped before its end
    write_run(tmp_path / "4", ["seed=4"], {"steps": 4})  # of an earlier sweep into this folder; now it failed
    (tmp_path / "4" / FAILED_RUN).write_text("2 seed=4: no")
    runs, swept = read_runs(tmp_path)
    assert swept == ["+x"]
    assert runs.to_dict("list") == {"+x": ["'a=2'", "'a=9'", "'a=10'"], "steps": [2, 9, 10]}


def test_read_runs_counts_a_missing_override_as_a_setting(tmp_path: Path) -> None:
    write_run(tmp_path / "0", ["~logger", "descriptor=orb"], {"steps": 1})
    write_run(tmp_path / "1", ["~logger"], {"steps": 2})
    runs, swept = read_runs(tmp_path)
    assert swept == ["descriptor"]
    assert runs["descriptor"].fillna("none").tolist() == ["orb", "none"]


def test_read_runs_of_an_empty_folder(tmp_path: Path) -> None:
    runs, swept = read_runs(tmp_path)
    assert (len(runs), swept) == (0, [])


def test_write_summary_in_every_form(tmp_path: Path) -> None:
    runs = pd.DataFrame({"sigma0": ["0.3", "0.3", "0.5"], "objective": [0.25, 0.5, 1 / 3], "steps": [6.0, 6.0, 6.0]})
    write_summary(runs, ["sigma0"], tmp_path)
    lines = (tmp_path / "summary.md").read_text().splitlines()
    assert [" ".join(line.split()) for line in (lines[0], *lines[2:])] == [
        "| sigma0 | runs | objective | steps |",
        "| 0.3 | 2 | 0.375 ± 0.18 | 6 ± 0 |",
        "| 0.5 | 1 | 0.3333 | 6 |",
    ]
    rows = json.loads((tmp_path / "summary.json").read_text())
    deviation = pytest.approx(0.125 * 2**0.5)
    first = {"sigma0": "0.3", "runs": 2, "objective": 0.375, "objective_sd": deviation, "steps": 6.0, "steps_sd": 0.0}
    second = {"sigma0": "0.5", "runs": 1, "objective": 1 / 3, "objective_sd": None, "steps": 6.0, "steps_sd": None}
    assert rows == [first, second]
    with (tmp_path / "summary.csv").open(newline="") as file:
        table = list(csv.DictReader(file))
    assert [row["objective"] for row in table] == ["0.375", str(1 / 3)]
    assert table[1]["objective_sd"] == ""
    assert cv2.imread(str(tmp_path / "summary.png")) is not None


@pytest.mark.parametrize(
    ("key", "titles"),
    [
        ("kernel", ["top-1 accuracy", "RSW"]),
        ("objective.sigma0", ["top-1 accuracy", "RSW"]),
        ("features.color", ["top-1 accuracy", "objective", "RSW"]),
    ],
)
def test_objectives_of_different_kinds_are_not_compared(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, key: str, titles: list[str]
) -> None:
    drawn: list[list[str]] = []
    monkeypatch.setattr(
        "geoskill.viz.bars.save_figure", lambda figure, _: drawn.append([axes.get_title() for axes in figure.axes])
    )
    runs = pd.DataFrame({key: ["a", "b"], "objective": [0.2, 9.0], "rsw": [0.1, 0.2], "top1_accuracy": [0.5, 1.0]})
    write_summary(runs, [key], tmp_path)
    assert drawn == [titles]
    assert "objective" in (tmp_path / "summary.md").read_text().split("|", 3)[3]  # the table has all


def test_failed_runs_are_told_after_the_summary_of_the_others(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_run(tmp_path / "0", ["model.layers=1", "seed=0"], {"objective": 1.0})
    for number, status in ((1, 1), (2, 2)):
        write_run(tmp_path / str(number), [f"model.layers={number - 2}"], None)
        (tmp_path / str(number) / FAILED_RUN).write_text(f"{status} model.layers={number - 2}: expected at least 1\n")
    with pytest.raises(SystemExit) as ending:
        SweepSummary().on_multirun_end(OmegaConf.create({"hydra": {"sweep": {"dir": str(tmp_path)}}}))
    assert ending.value.code == 1
    captured = capsys.readouterr()
    assert captured.err == f"error: 2 run(s) failed, first {tmp_path / '1'}: model.layers=-1: expected at least 1\n"
    assert captured.out.splitlines()[-1] == str(tmp_path)
    assert (tmp_path / "summary.md").is_file()


@pytest.mark.slow
def test_a_sweep(script: Command, tiny: Sequence[str], tmp_path: Path) -> None:
    overrides = ["objective.sigma0=0.3,0.55", "seed=0,1", "trainer.max_epochs=1"]
    launcher = ["hydra/launcher=joblib", "hydra.launcher.n_jobs=2", f"hydra.sweep.dir={tmp_path}"]
    ended = script("train", "-m", *tiny, *overrides, *launcher)
    assert (ended.status, ended.folder) == (0, tmp_path), ended.stderr
    rows = json.loads((tmp_path / "summary.json").read_text())
    assert [(row["objective.sigma0"], row["runs"], row["steps"]) for row in rows] == [("0.3", 2, 3.0), ("0.55", 2, 3.0)]
    objectives = [json.loads((tmp_path / str(job) / "metrics.json").read_text())["objective"] for job in range(4)]
    assert len(set(objectives)) == 4
    assert rows[0]["objective"] == pytest.approx((objectives[0] + objectives[1]) / 2)
    assert len((tmp_path / "summary.md").read_text().splitlines()) == 4
    with (tmp_path / "summary.csv").open(newline="") as file:
        assert [row["objective.sigma0"] for row in csv.DictReader(file)] == ["0.3", "0.55"]
    assert cv2.imread(str(tmp_path / "summary.png")) is not None


@pytest.mark.slow
def test_a_sweep_with_a_run_that_fails(script: Command, tiny: Sequence[str], tmp_path: Path) -> None:
    ended = script("train", "-m", *tiny, "objective.sigma0=-1,0.55", f"hydra.sweep.dir={tmp_path}")
    assert (ended.status, ended.folder) == (2, tmp_path)
    assert ended.stderr.startswith(f"error: 1 run(s) failed, first {tmp_path / '0'}: objective.sigma0=-1: expected")
    assert len(ended.stderr.splitlines()) == 1
    assert len(json.loads((tmp_path / "summary.json").read_text())) == 1


@pytest.mark.slow
def test_ablation_experiment_is_a_sweep(script: Command, tiny: Sequence[str], tmp_path: Path) -> None:
    given = [override for override in tiny if not override.startswith(("logger", "threads"))]
    swept = ["objective.rsw_weight=0.0,1.0", "seed=0", "trainer.max_epochs=1", "hydra.launcher.n_jobs=1"]
    ended = script("train", "-m", "experiment=ablation_lambda", *given, *swept, f"hydra.sweep.dir={tmp_path}")
    assert (ended.status, ended.folder) == (0, tmp_path), ended.stderr
    rows = json.loads((tmp_path / "summary.json").read_text())
    assert [(row["objective.rsw_weight"], row["runs"]) for row in rows] == [("0.0", 1), ("1.0", 1)]


@pytest.mark.parametrize("content", ["", "{", "[1]", "\x00", '{"steps": 1'])
def test_damaged_results_leave_the_others_in_the_summary(
    tmp_path: Path, content: str, capsys: pytest.CaptureFixture[str]
) -> None:
    for number in range(3):
        write_run(tmp_path / str(number), [f"seed={number}"], {"steps": number})
    (tmp_path / "1" / "metrics.json").write_text(content)
    runs, _ = read_runs(tmp_path)
    assert runs.to_dict("list") == {"steps": [0, 2]}
    warning = capsys.readouterr().err
    assert warning.startswith(f"warning: {tmp_path / '1'}: left out, its results cannot be read (")
    assert len(warning.splitlines()) == 1


def test_damaged_overrides_leave_the_others_in_the_summary(tmp_path: Path) -> None:
    for number in range(2):
        write_run(tmp_path / str(number), [f"seed={number}"], {"steps": number})
    (tmp_path / "0" / ".hydra" / "overrides.yaml").write_text("[unfinished")
    runs, _ = read_runs(tmp_path)
    assert runs.to_dict("list") == {"steps": [1]}
