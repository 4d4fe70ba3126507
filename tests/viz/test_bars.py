"""Pictures of several trainings: drawn without a display, and different when the numbers are."""

from pathlib import Path

import cv2
import pandas as pd
import pytest

from geoskill.viz.bars import plot_bars, plot_reliability, plot_summary, plot_trainings


def test_plot_bars_shows_variants_test_sets_and_published_values(tmp_path: Path) -> None:
    rows = {"ours": [[90.0, 100.0], []], "other": [[20.0], [30.0]]}
    plot_bars(["human", "robot"], rows, {"ours": {"human": 80.0}, "theirs": {"robot": 70.0}}, tmp_path / "a.png")
    plot_bars(["human", "robot"], rows, {}, tmp_path / "b.png")
    first, second = (cv2.imread(str(tmp_path / name)) for name in ("a.png", "b.png"))
    assert first.shape[0] > second.shape[0]  # a row more
    assert first.std() > 10


def test_plot_trainings_of_different_lengths_stops_at_the_shortest(tmp_path: Path) -> None:
    paths = []
    for number, steps in enumerate((40, 60)):
        lines = [f"{step},{0.01 * step},{0.5 / step}" for step in range(1, steps + 1)]
        path = tmp_path / f"{number}.csv"
        path.write_text("step,p2p_sift/objective,p2p_sift/rsw\n" + "\n".join(lines) + "\n")
        paths.append(path)
    plot_trainings({"default": paths}, tmp_path / "curves.png")
    assert cv2.imread(str(tmp_path / "curves.png")).std() > 5


def test_plot_trainings_refuses_a_missing_table(tmp_path: Path) -> None:
    with pytest.raises(Exception, match="expected a table of training metrics"):
        plot_trainings({"default": [tmp_path / "none.csv"]}, tmp_path / "curves.png")


def test_plot_reliability_of_calibrated_overconfident_and_no_frames(tmp_path: Path) -> None:
    empty = [(0, 0.0, 0.0)] * 9
    plot_reliability({"sure": [*empty, (30, 0.95, 0.95)]}, tmp_path / "a.png")
    plot_reliability({"sure": [*empty, (30, 0.95, 0.1)]}, tmp_path / "b.png")
    plot_reliability({"none": [*empty, (0, 0.0, 0.0)]}, tmp_path / "c.png")
    first, second, third = (cv2.imread(str(tmp_path / f"{name}.png")) for name in "abc")
    assert first.shape == second.shape
    assert (first != second).any()
    assert third.std() > 5


def test_plot_summary_has_a_panel_per_metric_and_names_settings(tmp_path: Path) -> None:
    summary = pd.DataFrame({"kernel": ["p2p", None], "rsw": [0.1, 0.2], "rsw_sd": [0.01, None]})
    plot_summary(summary, ["kernel"], ["rsw"], tmp_path / "a.png")
    plot_summary(summary.assign(objective=[1.0, 2.0], objective_sd=0.5), [], ["rsw", "objective"], tmp_path / "b.png")
    first, second = (cv2.imread(str(tmp_path / name)) for name in ("a.png", "b.png"))
    assert (second.shape[0], second.shape[1]) == (first.shape[0], 2 * first.shape[1])
    assert first.std() > 5


def test_plot_trainings_draws_more_variants_than_colors(tmp_path: Path) -> None:
    path = tmp_path / "metrics.csv"
    path.write_text("step,p2p_sift/objective,p2p_sift/rsw\n1,0.1,0.5\n2,0.2,0.4\n")
    for number in (7, 8):
        plot_trainings({str(variant): [path] for variant in range(number)}, tmp_path / f"{number}.png")
    seven, eight = (cv2.imread(str(tmp_path / f"{number}.png")) for number in (7, 8))
    assert (seven != eight).any()
