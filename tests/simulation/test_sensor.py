"""Sensor: noise, exposure and compression."""

import cv2
import numpy as np

from geoskill.simulation.sensor import compress, expose, exposure_drift


def flat(level: int) -> np.ndarray:
    return np.full((120, 160, 3), level, np.uint8)


def test_expose_scales_and_draws_noise_by_the_seed() -> None:
    exposed = expose(flat(100), 1.2, np.random.default_rng(0))
    np.testing.assert_allclose(exposed.mean(axis=(0, 1)), 120, atol=0.3)
    np.testing.assert_array_equal(exposed, expose(flat(100), 1.2, np.random.default_rng(0)))
    assert np.any(exposed != expose(flat(100), 1.2, np.random.default_rng(1)))
    np.testing.assert_array_equal(expose(flat(255), 1.5, np.random.default_rng(0)), 255)  # saturated


def test_expose_noise_grows_with_the_root_of_the_intensity() -> None:
    # The variances of read and shot noise add; the variance that the noise's own blur removes is restored.
    for level in (20, 80, 200):
        deviation = expose(flat(level), 1.0, np.random.default_rng(0)).astype(float).std()
        np.testing.assert_allclose(deviation, np.sqrt(1.2**2 + 0.16**2 * level), rtol=0.15)


def test_expose_blurs_edges_slightly() -> None:
    image = flat(40)
    image[:, 80:] = 200
    row = expose(image, 1.0, np.random.default_rng(0)).astype(float).mean(axis=(0, 2))
    assert 45 < row[79] < 80
    assert 160 < row[80] < 195
    np.testing.assert_allclose([row[:75].mean(), row[85:].mean()], [40, 200], atol=0.5)


def test_exposure_drift_is_slow_and_small() -> None:
    for seed in range(20):
        exposures = exposure_drift(90, np.random.default_rng(seed))
        assert len(exposures) == 90
        assert np.all(np.abs(exposures - 1) <= 0.025)
        assert np.abs(np.diff(exposures)).max() < 0.004
        assert np.ptp(exposures) > 0.02


def test_compress_keeps_the_order_of_the_colors() -> None:
    image = flat(0)
    image[:, :80] = (200, 40, 90)
    decoded = cv2.imdecode(np.frombuffer(compress(image), np.uint8), cv2.IMREAD_COLOR)[..., ::-1]
    np.testing.assert_allclose(decoded[:, 8:72].mean(axis=(0, 1)), (200, 40, 90), atol=3)
