"""Pictures of several trainings: drawn without a display, whole, and different where the numbers are."""

from pathlib import Path

import cv2
import pytest

from geoskill.viz.bars import plot_bars, plot_reliability, plot_trainings


def test_bars_show_rows_tests_and_what_was_published(tmp_path: Path) -> None:
    rows = {"ours": [[90.0, 100.0], []], "other": [[20.0], [30.0]]}
    plot_bars(["human", "robot"], rows, {"ours": {"human": 80.0}, "theirs": {"robot": 70.0}}, tmp_path / "a.png")
    plot_bars(["human", "robot"], rows, {}, tmp_path / "b.png")
    first, second = (cv2.imread(str(tmp_path / name)) for name in ("a.png", "b.png"))
    assert first.shape[0] > second.shape[0]  # a row more
    assert first.std() > 10


def test_trainings_of_other_lengths_are_drawn_as_far_as_all_go(tmp_path: Path) -> None:
    paths = []
    for number, steps in enumerate((40, 60)):
        lines = [f"{step},{0.01 * step},{0.5 / step}" for step in range(1, steps + 1)]
        path = tmp_path / f"{number}.csv"
        path.write_text("step,p2p_sift/objective,p2p_sift/rsw\n" + "\n".join(lines) + "\n")
        paths.append(path)
    plot_trainings({"default": paths}, tmp_path / "curves.png")
    assert cv2.imread(str(tmp_path / "curves.png")).std() > 5


def test_a_table_that_is_not_there_is_refused(tmp_path: Path) -> None:
    with pytest.raises(Exception, match="expected a table of training metrics"):
        plot_trainings({"default": [tmp_path / "none.csv"]}, tmp_path / "curves.png")


def test_a_skill_that_is_right_as_often_as_it_is_sure_lies_on_the_diagonal(tmp_path: Path) -> None:
    empty = [(0, 0.0, 0.0)] * 9
    plot_reliability({"sure": [*empty, (30, 0.95, 0.95)]}, tmp_path / "a.png")
    plot_reliability({"sure": [*empty, (30, 0.95, 0.1)]}, tmp_path / "b.png")
    plot_reliability({"none": [*empty, (0, 0.0, 0.0)]}, tmp_path / "c.png")
    first, second, third = (cv2.imread(str(tmp_path / f"{name}.png")) for name in "abc")
    assert first.shape == second.shape
    assert (first != second).any()
    assert third.std() > 5
