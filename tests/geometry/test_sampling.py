"""Bilinear sampling: values, border, channels and many points."""

import numpy as np

from geoskill.geometry import sampling
from geoskill.geometry.sampling import sample_bilinear


def ramp(height: int = 20, width: int = 30) -> np.ndarray:
    y, x = np.mgrid[:height, :width].astype(np.float32)
    return np.stack([x, 10 * y], axis=2)


def test_sample_bilinear_a_ramp_is_exact_to_a_step_of_the_interpolation() -> None:
    xy = np.random.default_rng(0).uniform(0, 19, (5, 7, 2)).astype(np.float32)
    values = sample_bilinear(ramp(), xy)
    assert values.shape == (5, 7, 2)
    np.testing.assert_allclose(values, xy * [1, 10], atol=10 / 32)
    one_channel = sample_bilinear(np.ascontiguousarray(ramp()[..., 0]), xy)
    assert one_channel.shape == (5, 7)
    np.testing.assert_allclose(one_channel, xy[..., 0], atol=1 / 32)


def test_sample_bilinear_repeats_the_border() -> None:
    xy = np.array([[-5, -5], [100, 100]], np.float32)
    np.testing.assert_array_equal(sample_bilinear(ramp(), xy), [[0, 0], [29, 190]])


def test_sample_bilinear_accepts_more_points_than_opencv() -> None:
    xy = np.tile(np.array([[3, 4], [5, 6]], np.float32), (sampling.POINTS_PER_CALL, 1))
    np.testing.assert_array_equal(sample_bilinear(ramp(), xy), np.tile([[3, 40], [5, 60]], (len(xy) // 2, 1)))
