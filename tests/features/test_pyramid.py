"""Pyramid sampling: exact on a ramp, averaged over the size, one or several channels."""

import numpy as np
import pytest

from geoskill.features.pyramid import sample_at


def ramp(height: int = 40, width: int = 60) -> np.ndarray:
    y, x = np.mgrid[:height, :width].astype(np.float32)
    return np.stack([x, 10 * y], axis=2)


@pytest.mark.parametrize("size", [0.3, 1.0, 2.0, 4.0])
def test_sample_at_a_ramp_is_exact_at_every_size(size: float) -> None:
    positions = np.array([[[20.0, 16.5], [25.25, 20.0]], [[30.5, 18.0], [22.0, 19.75]]], np.float32)
    values = sample_at(ramp(), positions, np.full(2, size, np.float32))
    # Interpolation is in 32 steps between two pixels of a level.
    np.testing.assert_allclose(values, positions * [1, 10], atol=0.02 * 10 * max(1, size))
    assert values.dtype == np.float32


def test_sample_at_averages_over_the_size() -> None:
    """Stripes one pixel wide become gray when four pixels are averaged."""
    stripes = np.zeros((64, 64), np.float32)
    stripes[:, ::2] = 100.0
    positions = np.array([[[20.0, 30.0], [21.0, 30.0]]] * 2, np.float32)
    fine, coarse = sample_at(stripes, positions, np.array([1.0, 4.0], np.float32))
    np.testing.assert_allclose(fine, [100, 0])
    np.testing.assert_allclose(coarse, [50, 50], atol=2)


def test_sample_at_repeats_the_border_and_the_coarsest_level() -> None:
    positions = np.array([[[-50.0, -50.0], [500.0, 500.0]]], np.float32)
    np.testing.assert_allclose(sample_at(ramp(), positions, np.ones(1, np.float32)), [[[0, 0], [59, 390]]])
    tiny = np.full((2, 2), 7.0, np.float32)
    np.testing.assert_allclose(sample_at(tiny, positions, np.full(1, 1000.0, np.float32)), [[7, 7]])


def test_sample_at_no_feature() -> None:
    assert sample_at(ramp(), np.zeros((0, 5, 2), np.float32), np.zeros(0, np.float32)).shape == (0, 5, 2)
