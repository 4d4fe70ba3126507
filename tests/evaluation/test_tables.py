"""Tables over several trainings, computed by hand."""

import csv
import io
import math
from typing import Any

import pandas as pd
import pytest

from geoskill.evaluation import tables


def metrics(accuracy: float | None, **others: Any) -> dict[str, Any]:
    # Half of the frames with a confidence of 0.7 and 0.75 of them right, the others with 0.1 and all wrong.
    bins = [[0, 0.0, 0.0]] * 10
    bins[7], bins[1] = [20, 0.7, 0.75], [20, 0.1, 0.0]
    return {
        "top1_accuracy": accuracy,
        "hand_rate": 0.25,
        "feasible_frames": 40,
        "frames": 41,
        "reliability": bins,
        **others,
    }


def seeds(*accuracies: float | None) -> list[dict[str, Any]]:
    return [
        {"seed": number, "rsw": 0.002 * (number + 1), "steps": 400, "here": metrics(value)}
        for number, value in enumerate(accuracies)
    ]


def cells(table: str) -> list[list[str]]:
    """The rows of a Markdown table without the line below the head."""
    lines = [[cell.strip() for cell in line.strip("|").split("|")] for line in table.splitlines()]
    return [lines[0], *lines[2:]]


def test_summarize_averages_over_seeds() -> None:
    runs = pd.DataFrame(
        {
            "objective.sigma0": ["0.3", "0.3", "0.3", "0.5"],
            "objective": [1.0, 2.0, 3.0, 9.0],
            "rsw": [0.5, 0.5, 0.5, None],
            "steps": [4.0, 4.0, 7.0, 1.0],
            "source": ["a", "b", "c", "d"],
        }
    )
    summary = tables.summarize(runs, ["objective.sigma0"])
    columns = ["objective.sigma0", "runs", "objective", "objective_sd", "rsw", "rsw_sd", "steps", "steps_sd"]
    assert list(summary) == columns
    # 1, 2, 3: mean 2, variance (1 + 0 + 1) / 2. 4, 4, 7: mean 5, variance (1 + 1 + 4) / 2.
    assert summary.iloc[0].tolist() == ["0.3", 3, 2.0, 1.0, 0.5, 0.0, 5.0, pytest.approx(math.sqrt(3))]
    assert summary.iloc[1].fillna("none").tolist() == ["0.5", 1, 9.0, "none", "none", "none", 1.0, "none"]


def test_summarize_without_settings_has_one_row() -> None:
    summary = tables.summarize(pd.DataFrame({"objective": [0.0, 1.0]}), [])
    assert summary.to_dict("records") == [{"runs": 2, "objective": 0.5, "objective_sd": pytest.approx(0.5**0.5)}]


def test_summarize_keeps_settings_that_some_runs_lack_in_order() -> None:
    runs = pd.DataFrame(
        {"kernel": ["par", "p2p", "p2p"], "descriptor": [None, "orb", None], "objective": [3.0, 1.0, 2.0]}
    )
    summary = tables.summarize(runs, ["kernel", "descriptor"])
    assert summary["objective"].tolist() == [3.0, 1.0, 2.0]
    assert summary["descriptor"].fillna("none").tolist() == ["none", "orb", "none"]


def test_summary_table_has_mean_and_deviation_in_a_cell() -> None:
    summary = pd.DataFrame(
        {
            "sigma0": ["0.3", None, "1"],
            "runs": [2, 1, 1],
            "objective": [0.25, 1 / 3, math.nan],
            "objective_sd": [0.125, math.nan, math.nan],
        }
    )
    assert cells(tables.summary_table(summary)) == [
        ["sigma0", "runs", "objective"],
        ["0.3", "2", "0.25 ± 0.12"],
        ["", "1", "0.3333"],
        ["1", "1", ""],
    ]


def test_overview_has_mean_deviation_median_and_worst_seed() -> None:
    head, row = cells(tables.overview({"default": seeds(0.9, 0.5, 1.0)}, ["here"], {}))
    assert head == ["", "seeds", "here", "RSW", "steps"]
    # The standard deviation of 90, 50 and 100 is sqrt((10**2 + 30**2 + 20**2) / 2) = 26.5.
    assert row == ["default", "3", "80.0 ± 26.5, median 90.0, worst 50.0", "0.40 %", "400"]


def test_overview_of_one_seed_and_of_no_feasible_frame() -> None:
    rows = cells(tables.overview({"one": seeds(0.5), "none": seeds(None)}, ["here"], {}))
    assert rows[1] == ["one", "1", "50.0", "0.20 %", "400"]
    assert rows[2] == ["none", "1", "none", "0.20 %", "400"]


def test_overview_has_published_values_beside_the_variant_or_below() -> None:
    published = {"ours": {"here": 40.0}, "theirs": {"here": 99.1}, "else": {}}
    rows = cells(tables.overview({"ours": seeds(0.5)}, ["here"], published))
    assert rows[1] == ["ours", "1", "50.0 (published 40.0)", "0.20 %", "400"]
    assert rows[2] == ["theirs", "", "99.1", "", ""]
    assert rows[3] == ["else", "", "", "", ""]


def test_details_average_the_metrics_that_are_known() -> None:
    scores = seeds(0.9, 0.5)
    scores[0]["here"]["strict_accuracy"] = 0.2
    scores[1]["here"]["oracle_strict_accuracy"] = 0.4
    scores[0]["here"]["goal_error_mm"], scores[1]["here"]["goal_error_mm"] = 4.0, 5.0
    head, row, all_frames = cells(tables.details({"default": scores}, ["here"]))
    assert head[:7] == ["", "test set", "top-1", "strict", "oracle", "error at the goal [mm]", "oracle [mm]"]
    assert row == ["default", "here", "0.700", "0.200", "0.400", "4.5", "", "", "0.250", "", "", "80 of 82", ""]
    # (0.05 + 0.1) / 2
    assert all_frames == ["default", "all", *[""] * 10, "0.075"]


def test_csv_table_has_a_line_per_seed_and_test_set_with_numbers_only() -> None:
    scores = seeds(0.9, None)
    scores[0]["here"]["members"] = {"p2p/sift": {}}
    scores[0]["here"]["strict_accuracy"] = scores[1]["here"]["strict_accuracy"] = None
    text = tables.csv_table(tables.score_frame({"default": scores}, ["here"]))
    assert text.splitlines() == [
        "variant,seed,test_set,training_rsw,top1_accuracy,hand_rate,feasible_frames,frames",
        "default,0,here,0.002,0.9,0.25,40,41",
        "default,1,here,0.004,,0.25,40,41",
    ]


def test_csv_table_of_trainings() -> None:
    rows = list(csv.DictReader(io.StringIO(tables.csv_table(tables.training_frame({"default": seeds(0.9, None)})))))
    assert rows[1] == {"variant": "default", "seed": "1", "rsw": "0.004", "steps": "400"}


def test_accuracies_are_percentages_of_the_seeds_that_have_one() -> None:
    frame = tables.score_frame({"b": seeds(0.5, None, 1.0), "a": seeds(None)}, ["here"])
    assert tables.accuracies(frame, ["here"]) == {"b": [[50.0, 100.0]], "a": [[]]}
    assert list(tables.accuracies(frame, ["here"])) == ["b", "a"]


def test_baseline_success_is_a_percentage_of_recordings() -> None:
    scores = seeds(0.9, 0.8)
    for training, success in zip(scores, (True, False), strict=True):
        training["here"]["baseline_success"] = success
    frame = tables.score_frame({"ours": scores, "other": scores[:1]}, ["here"])
    assert tables.baseline_success(frame) == {"here": 50.0}


def test_reliability_of_pools_all_rows() -> None:
    frame = tables.score_frame({"ours": seeds(0.9, 0.8)}, ["here"])
    assert [tuple(tables.reliability_of(frame)[number]) for number in (0, 7)] == [(0, 0, 0), (40, 0.7, 0.75)]
