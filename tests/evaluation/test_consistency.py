"""Tests of the autocorrelation of a series with gaps."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from geoskill.evaluation.consistency import autocorrelation

SERIES = st.lists(st.one_of(st.none(), st.floats(-100, 100)), max_size=12)


@pytest.mark.parametrize(
    ("values", "expected"),
    [
        ([1.0, -1.0, 1.0, -1.0, 1.0, -1.0], -1.0),
        # Mean 1.5, variance 1.25; products 0.75, -0.25, 0.75.
        ([0.0, 1.0, 2.0, 3.0], 1 / 3),
        # Mean 1.2, variance 1.36; of three pairs the products 0.24, -0.16, 1.44.
        ([0.0, None, 0.0, 1.0, 2.0, 3.0], 1.52 / 3 / 1.36),
        ([], None),
        ([1.0, 2.0, 3.0], None),  # two pairs
        ([1.0, None, 2.0, None, 3.0, None, 4.0], None),  # none
        ([2.0, 2.0, 2.0, 2.0, 2.0], None),  # no variance
        ([None] * 9, None),
    ],
)
def test_autocorrelation_by_hand(values: list[float | None], expected: float | None) -> None:
    assert autocorrelation(values) == (None if expected is None else pytest.approx(expected))


@given(SERIES, st.integers(-5, 5), st.sampled_from([-4.0, -0.5, 2.0, 8.0]))
def test_autocorrelation_ignores_unit_offset_and_direction(
    values: list[float | None], shift: int, factor: float
) -> None:
    rounded = [None if value is None else float(round(value)) for value in values]  # so that sums are exact
    expected = autocorrelation(rounded)
    scaled = autocorrelation([None if value is None else factor * value + shift for value in rounded])
    backwards = autocorrelation(rounded[::-1])
    for value in (scaled, backwards):
        assert value == (None if expected is None else pytest.approx(expected, abs=1e-9))
