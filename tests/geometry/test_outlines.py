"""Distances to outlines, whichever way round their corners are listed."""

import numpy as np

from geoskill.geometry.outlines import distance_to_outline


def test_distance_does_not_depend_on_the_order_of_corners() -> None:
    box = np.array([[10.0, 20.0], [13.0, 24.0], [9.0, 27.0], [6.0, 23.0]])  # 5 by 5, turned
    points = np.array([[9.5, 23.5], [13.0, 24.0], [16.0, 28.0], [12.0, 17.0]])
    expected = [0.0, 0.0, 5.0, 3.4]
    orders = np.array([np.roll(np.arange(4), shift)[::way] for shift in range(4) for way in (1, -1)])
    distances = distance_to_outline(points, box[orders].reshape(8, 8))
    np.testing.assert_allclose(distances, np.tile(np.array(expected)[:, None], 8), atol=1e-5)


def test_without_points_or_outlines() -> None:
    assert distance_to_outline(np.zeros((0, 2)), np.zeros((3, 8))).shape == (0, 3)
    assert distance_to_outline(np.zeros((2, 2)), np.zeros((0, 8))).shape == (2, 0)
