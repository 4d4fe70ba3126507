"""Intrinsics of a depth picture: numbers by hand, and OpenCV as a reference."""

import cv2
import numpy as np
import pytest

from geoskill.geometry.depth_camera import D435_NOISE_PER_M, DepthCamera

CAMERA = DepthCamera(610.0, 605.0, 321.5, 238.0)


def test_back_project_and_project_agree_with_opencv() -> None:
    random = np.random.default_rng(0)
    pixels, depth_m = random.uniform((0, 0), (640, 480), (50, 2)), random.uniform(0.3, 2.0, 50)
    points = CAMERA.back_project(pixels, depth_m)
    matrix = np.array([[610.0, 0, 321.5], [0, 605.0, 238.0], [0, 0, 1]])
    projected = cv2.projectPoints(points, np.zeros(3), np.zeros(3), matrix, None)[0][:, 0]
    np.testing.assert_allclose(projected, pixels, atol=1e-9)
    np.testing.assert_allclose(CAMERA.project(points), pixels, atol=1e-9)
    np.testing.assert_array_equal(points[:, 2], depth_m)


def test_noise_is_that_of_the_data_sheet() -> None:
    # 0.9 and 1.8 mm at 0.5 and 0.7 m.
    np.testing.assert_allclose(CAMERA.depth_std_m(np.array([0.5, 0.7])), [0.9e-3, 1.8e-3], atol=0.05e-3)
    assert CAMERA.noise_per_m == D435_NOISE_PER_M


@pytest.mark.parametrize("arguments", [(0, 1, 1, 1), (1, -1, 1, 1), (1, 1, np.nan, 1), (1, 1, 1, 1, -0.1)])
def test_camera_refuses_impossible_intrinsics(arguments: tuple[float, ...]) -> None:
    with pytest.raises(ValueError, match="expected"):
        DepthCamera(*arguments)
