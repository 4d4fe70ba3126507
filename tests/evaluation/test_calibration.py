"""Confidence beside accuracy, by hand."""

import pytest

from geoskill.evaluation.calibration import BINS, expected_calibration_error, pooled, reliability


def test_frames_are_sorted_by_confidence() -> None:
    bins = reliability([(0.0, False), (0.05, True), (0.3, False), (0.39, True), (1.0, True)])
    assert len(bins) == BINS
    assert bins[0] == (2, pytest.approx(0.025), 0.5)
    assert bins[3] == (2, pytest.approx(0.345), 0.5)
    assert bins[9] == (1, 1.0, 1.0)
    assert sum(each.frames for each in bins) == 5
    # (2 x 0.475 + 2 x 0.155 + 0) / 5
    assert expected_calibration_error(bins) == pytest.approx(0.252)


def test_who_is_right_as_often_as_confident_has_no_error() -> None:
    judged = [(0.75, right) for right in (True, True, True, False)] + [(0.5, True), (0.5, False)]
    assert expected_calibration_error(reliability(judged)) == 0
    assert expected_calibration_error(reliability([(0.9, False)])) == pytest.approx(0.9)
    assert expected_calibration_error(reliability([])) is None


def test_parts_pooled_are_the_whole() -> None:
    first, second = [(0.1, True), (0.95, True)], [(0.12, False), (0.55, True), (0.91, False)]
    together = pooled([[list(each) for each in reliability(part)] for part in (first, second)])
    for one, other in zip(together, reliability(first + second), strict=True):
        assert one == pytest.approx(other)
    assert pooled([]) == reliability([])
