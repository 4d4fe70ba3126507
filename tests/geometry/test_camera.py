"""The pinhole camera: pixels by hand, and there and back."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from geoskill.geometry.camera import PinholeCamera, back_project, focal_length_px, look_at, project
from geoskill.geometry.poses import pose, rotation_about

SMALL = st.floats(-1, 1)
CAMERA = st.builds(
    lambda position, turn, focal: PinholeCamera(640, 480, focal, pose(position, rotation_about(np.array(turn)))),
    st.tuples(SMALL, SMALL, SMALL),
    st.tuples(SMALL, SMALL, SMALL),
    st.floats(50, 2000),
)


def test_pixels_and_depths_by_hand() -> None:
    camera = PinholeCamera(41, 31, 80.0, np.eye(4))
    np.testing.assert_array_equal(camera.center_px, [20, 15])
    # Right and down are positive; half as far is twice as large.
    points = np.array([[0.0, 0, 1], [0.1, 0, 1], [0, 0.1, 1], [0.1, 0.1, 0.5], [0, 0, -2]])
    pixels, depth = project(camera, points)
    np.testing.assert_allclose(pixels, [[20, 15], [28, 15], [20, 23], [36, 31], [20, 15]])
    np.testing.assert_array_equal(depth, [1, 1, 1, 0.5, -2])


def test_a_camera_that_was_moved_and_turned() -> None:
    # At (1, 0, 1), looking straight down, the world's x to the right: a point 10 cm to its right, and one behind (up).
    camera = PinholeCamera(41, 31, 80.0, pose((1.0, 0.0, 1.0), np.diag([1.0, -1.0, -1.0])))
    pixels, depth = project(camera, np.array([[1.1, 0.0, 0.0], [1.0, 0.1, 0.2]]))
    np.testing.assert_allclose(pixels, [[28, 15], [20, 5]])
    np.testing.assert_allclose(depth, [1.0, 0.8])


def test_depth_is_along_the_axis_not_along_the_ray() -> None:
    camera = PinholeCamera(41, 31, 80.0, np.eye(4))
    there = back_project(camera, np.array([[20.0, 15.0], [36.0, 31.0]]), np.array([2.0, 2.0]))
    np.testing.assert_allclose(there, [[0, 0, 2], [0.4, 0.4, 2]])


@given(CAMERA, st.lists(st.tuples(st.floats(-50, 700), st.floats(-50, 500), st.floats(0.05, 10)), max_size=4))
def test_there_and_back(camera: PinholeCamera, rows: list[tuple[float, float, float]]) -> None:
    pixels, depth_m = np.array(rows, float).reshape(-1, 3)[:, :2], np.array(rows, float).reshape(-1, 3)[:, 2]
    found, depth = project(camera, back_project(camera, pixels, depth_m))
    np.testing.assert_allclose(found, pixels, atol=1e-6)
    np.testing.assert_allclose(depth, depth_m, rtol=1e-9)


def test_the_focal_length_of_an_angle_of_view() -> None:
    # A quarter turn from top to bottom: half the height is as far away as it is high.
    assert focal_length_px(480, math.pi / 2) == pytest.approx(240)
    # A ray at half of the angle meets the picture's border, half a pixel beyond the last row's center.
    focal = focal_length_px(480, 0.7)
    camera = PinholeCamera(640, 480, focal, np.eye(4))
    ((_, row),), _ = project(camera, np.array([[0.0, math.tan(0.35), 1.0]]))
    assert row == pytest.approx(479.5)


def test_looking_at_something_by_hand() -> None:
    # From 1 m in front of the origin (at negative y): x is to the right, up is up.
    camera = PinholeCamera(41, 31, 80.0, look_at(np.array([0.0, -1.0, 0.0]), np.zeros(3)))
    pixels, depth = project(camera, np.array([[0.0, 0, 0], [0.1, 0, 0], [0, 0, 0.1], [0, 1, 0]]))
    np.testing.assert_allclose(pixels, [[20, 15], [28, 15], [20, 7], [20, 15]], atol=1e-12)
    np.testing.assert_allclose(depth, [1, 1, 1, 2])


def test_a_camera_rolled_clockwise_shows_things_turned_counterclockwise() -> None:
    camera = PinholeCamera(41, 31, 80.0, look_at(np.array([0.0, -1.0, 0.0]), np.zeros(3), math.pi / 2))
    pixels, _ = project(camera, np.array([[0.0, 0, 0.1], [0.1, 0, 0]]))
    np.testing.assert_allclose(pixels, [[12, 15], [20, 7]], atol=1e-12)  # what was up is left, what was right is up


@given(
    st.tuples(SMALL, SMALL, st.floats(0.2, 2)).map(np.array),
    st.tuples(st.floats(2, 3), SMALL, SMALL).map(np.array),
    st.floats(-3, 3),
)
def test_what_is_looked_at_is_in_the_middle_and_the_axes_are_right_handed(
    position: np.ndarray, target: np.ndarray, roll: float
) -> None:
    matrix = look_at(position, target, roll)
    np.testing.assert_allclose(matrix[:3, :3].T @ matrix[:3, :3], np.eye(3), atol=1e-12)
    assert np.linalg.det(matrix) == pytest.approx(1)
    camera = PinholeCamera(641, 481, 300.0, matrix)
    pixels, depth = project(camera, target[None])
    np.testing.assert_allclose(pixels, [[320, 240]], atol=1e-9)
    np.testing.assert_allclose(depth, [np.linalg.norm(target - position)])
    if roll == 0:
        above, _ = project(camera, (target + np.array([0, 0, 0.1]))[None])
        assert above[0, 0] == pytest.approx(320)
        assert above[0, 1] < 240
