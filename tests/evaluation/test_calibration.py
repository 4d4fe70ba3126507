"""Tests of reliability and calibration error, by hand."""

import pytest

from geoskill.evaluation.calibration import BINS, expected_calibration_error, pooled, reliability


def test_reliability_by_hand() -> None:
    bins = reliability([(0.0, False), (0.05, True), (0.3, False), (0.39, True), (1.0, True)])
    assert len(bins) == BINS
    assert bins[0] == (2, pytest.approx(0.025), 0.5)
    assert bins[3] == (2, pytest.approx(0.345), 0.5)
    assert bins[9] == (1, 1.0, 1.0)
    assert sum(reliability_bin.frames for reliability_bin in bins) == 5
    # (2 x 0.475 + 2 x 0.155 + 0) / 5
    assert expected_calibration_error(bins) == pytest.approx(0.252)


def test_expected_calibration_error() -> None:
    outcomes = [(0.75, right) for right in (True, True, True, False)] + [(0.5, True), (0.5, False)]
    assert expected_calibration_error(reliability(outcomes)) == 0
    assert expected_calibration_error(reliability([(0.9, False)])) == pytest.approx(0.9)
    assert expected_calibration_error(reliability([])) is None


def test_pooled_equals_reliability_of_the_whole() -> None:
    first, second = [(0.1, True), (0.95, True)], [(0.12, False), (0.55, True), (0.91, False)]
    together = pooled([[list(row) for row in reliability(outcomes)] for outcomes in (first, second)])
    for pooled_bin, expected in zip(together, reliability(first + second), strict=True):
        assert pooled_bin == pytest.approx(expected)
    assert pooled([]) == reliability([])
