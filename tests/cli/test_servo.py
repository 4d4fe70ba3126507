"""``servo.py`` on points: what it writes, that it goes on where it was stopped, and what it refuses."""

import csv
import json
from pathlib import Path
from typing import Any

import pytest

from geoskill.control.trial import TrialResult
from geoskill.evaluation.servo import is_success, summarize_trials, wilson_interval
from tests.cli.test_bad_input import check_error
from tests.command_runs import Command

ROW = {
    "ended": "done",
    "reason": "",
    "start_mm": 150.0,
    "start_deg": 20.0,
    "mm": 1.0,
    "along_mm": 0.5,
    "across_mm": 0.8,
    "deg": 0.4,
    "steps": 80,
    "path_ratio": 1.2,
    "held": 0,
    "wrong_top": 3,
    "rank": 3,
    "predicted_mm": 0.5,
    "predicted_deg": 0.1,
    "seconds": 0.01,
    "explorations": 1,
    "violations": 0,
}


def test_points_are_servoed_and_a_stopped_run_goes_on(command: Command, tmp_path: Path) -> None:
    folder = tmp_path / "run"
    first = command("servo", "plant=points", "faults=none", "trials=1", f"hydra.run.dir={folder}")
    assert first.status == 0, first.stderr
    assert first.folder == folder
    begun = (folder / "trials.csv").read_text()
    second = command("servo", "plant=points", "faults=none", "trials=2", f"hydra.run.dir={folder}")
    assert second.status == 0, second.stderr
    assert "trial 0" not in second.stdout
    assert (folder / "trials.csv").read_text().startswith(begun)
    metrics = json.loads((folder / "metrics.json").read_text())
    assert {"trials", "success_rate", "median_mm", "median_deg"} <= set(metrics)
    assert (metrics["trials"], metrics["success_rate"], metrics["violations"]) == (2, 1.0, 0)
    assert metrics["median_mm"] < 2
    assert (folder / "servo.png").stat().st_size > 10_000
    with (folder / "frames.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert {row["trial"] for row in rows} == {"0", "1"}
    check_error(
        command("servo", "plant=points", "faults=all", "trials=2", f"hydra.run.dir={folder}"),
        2,
        str(folder),
        "was begun with faults=none",
        "expected faults=all, or another hydra.run.dir",
    )
    (folder / "trials.csv").write_text("trial,ended\n0,done\n")
    check_error(
        command("servo", "plant=points", "faults=none", f"hydra.run.dir={folder}"), 2, "trials.csv: cannot be read"
    )


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["plant=points", "skill=a.ckpt"], ["skill=a.ckpt: plant=points has no pictures; expected plant=scene"]),
        (["plant=points", "definition=a.yaml"], ["definition=a.yaml: plant=points has no pictures"]),
        (["phases=some"], ["phases=some: expected learned or none"]),
        (["plant=scene", "faults=all"], ["faults=all: only plant=points has faults"]),
        (["plant=scene"], ["skill is not set"]),
        (["plant=scene", "task=video"], ["task is no simulated task"]),
        (["trials=0"], ["trials=0: expected a whole number of at least 1"]),
        (["cameras=3"], ["cameras=3: expected"]),
        (["dof=all"], ["dof=all: expected descent, xyzy or xyzabc"]),
        (["servo.gain=0"], ["servo.gain=0: expected a number above 0 and at most 1"]),
        (["controller=pid"], ["pid"]),
        (["faults=some"], ["faults=some: expected"]),
        (["seed=-1"], ["seed=-1: expected"]),
    ],
    ids=lambda own: " ".join(own),
)
def test_bad_settings(command: Command, tmp_path: Path, arguments: list[str], words: list[str]) -> None:
    check_error(command("servo", *arguments, f"hydra.run.dir={tmp_path / 'run'}"), 2, *words)


def test_wilson_interval_is_that_of_the_literature() -> None:
    """Values of Newcombe, Statistics in Medicine 1998, table I: 81 of 263, and 0 of 20."""
    assert wilson_interval(81, 263) == pytest.approx((0.2553, 0.3662), abs=1e-4)
    assert wilson_interval(0, 20) == pytest.approx((0.0, 0.1611), abs=1e-4)
    with pytest.raises(ValueError, match="3 successes of 2 trials"):
        wilson_interval(3, 2)


def test_summary_counts_what_was_done_and_near() -> None:
    def result(**changed: Any) -> TrialResult:
        return TrialResult(**{**ROW, **changed})  # type: ignore[arg-type]

    results = [result(), result(mm=4.0, deg=3.5), result(ended="lost", mm=0.1), result(mm=20.0), result(mm=12.0)]
    assert [is_success(own) for own in results] == [True, False, False, False, False]
    metrics = summarize_trials(results)
    assert (metrics["success_rate"], metrics["success_rate_coarse"], metrics["done_rate"]) == (0.2, 0.6, 0.8)
    assert metrics["median_mm"] == 4.0
    assert metrics["predicted_within_factor_2"] == 0.2


@pytest.mark.slow
def test_rendered_scene_with_the_ground_truth(command: Command, tmp_path: Path) -> None:
    """With the exact places and the exact field, nothing is left to be explained."""
    ended = command(
        "servo", "plant=scene", "controller=truth", "task=sorting", "trials=1", f"hydra.run.dir={tmp_path / 'run'}"
    )
    assert ended.status == 0, ended.stderr
    metrics = json.loads((tmp_path / "run" / "metrics.json").read_text())
    assert metrics["success_rate"] == 1.0
    assert metrics["median_mm"] < 1.0
