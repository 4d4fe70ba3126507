"""Tables over several trainings, by hand."""

import csv
import io
from typing import Any

from geoskill.evaluation.tables import accuracies, as_csv, details, overview


def figures(accuracy: float | None, **others: Any) -> dict[str, Any]:
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
        {"seed": number, "rsw": 0.002 * (number + 1), "steps": 400, "here": figures(value)}
        for number, value in enumerate(accuracies)
    ]


def test_a_row_has_mean_spread_median_and_worst_seed() -> None:
    rows = overview({"default": seeds(0.9, 0.5, 1.0)}, ["here"], {}).splitlines()
    assert rows[0] == "| | seeds | here | RSW | steps |"
    # The standard deviation of 90, 50 and 100 is sqrt((10**2 + 30**2 + 20**2) / 2) = 26.5.
    assert rows[2] == "| default | 3 | 80.0 ± 26.5, median 90.0, worst 50.0 | 0.40 % | 400 |"


def test_one_seed_has_no_spread_and_nothing_feasible_is_no_number() -> None:
    rows = overview({"one": seeds(0.5), "none": seeds(None)}, ["here"], {}).splitlines()
    assert rows[2] == "| one | 1 | 50.0 | 0.20 % | 400 |"
    assert rows[3] == "| none | 1 | none | 0.20 % | 400 |"


def test_published_figures_stand_beside_the_row_of_their_name_or_in_one_of_their_own() -> None:
    table = overview({"ours": seeds(0.5)}, ["here"], {"ours": {"here": 40.0}, "theirs": {"here": 99.1}, "else": {}})
    rows = table.splitlines()
    assert rows[2] == "| ours | 1 | 50.0 (published 40.0) | 0.20 % | 400 |"
    assert rows[3] == "| theirs | | 99.1 | | |"
    assert rows[4] == "| else | | | | |"


def test_details_average_what_is_known() -> None:
    scores = seeds(0.9, 0.5)
    scores[0]["here"]["strict_accuracy"] = 0.2
    scores[1]["here"]["oracle_strict_accuracy"] = 0.4
    scores[0]["here"]["goal_error_mm"], scores[1]["here"]["goal_error_mm"] = 4.0, 5.0
    head, _, row, all_frames = details({"default": scores}, ["here"]).splitlines()
    assert head.startswith("| | test | top-1 | strict | oracle | error at the goal [mm] | oracle [mm] | precis")
    assert row == "| default | here | 0.700 | 0.200 | 0.400 | 4.5 | | | 0.250 | | | 80 of 82 | |"
    # (0.05 + 0.1) / 2
    assert all_frames == "| default | all | | | | | | | | | | | 0.075 |"


def test_csv_has_a_line_per_seed_and_test_with_numbers_only() -> None:
    scores = seeds(0.9, None)
    scores[0]["here"]["members"] = {"p2p/sift": {}}
    rows = list(csv.DictReader(io.StringIO(as_csv({"default": scores}, ["here"]))))
    assert [row["seed"] for row in rows] == ["0", "1"]
    assert [row["top1_accuracy"] for row in rows] == ["0.9", ""]
    assert "members" not in rows[0]
    assert rows[1]["training_rsw"] == "0.004"


def test_accuracies_are_percentages_of_the_seeds_that_have_one() -> None:
    assert accuracies(seeds(0.5, None, 1.0), "here") == [50.0, 100.0]
    assert accuracies(seeds(0.5), "elsewhere") == []
