"""The pinhole camera: pixels computed by hand, and round trips."""

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


def test_project_gives_known_pixels_and_depths() -> None:
    camera = PinholeCamera(41, 31, 80.0, np.eye(4))
    np.testing.assert_array_equal(camera.center_px, [20, 15])
    # Right and down are positive; at half the distance, the offset doubles.
    points = np.array([[0.0, 0, 1], [0.1, 0, 1], [0, 0.1, 1], [0.1, 0.1, 0.5], [0, 0, -2]])
    pixels, depth = project(camera, points)
    np.testing.assert_allclose(pixels, [[20, 15], [28, 15], [20, 23], [36, 31], [20, 15]])
    np.testing.assert_array_equal(depth, [1, 1, 1, 0.5, -2])


def test_project_with_a_moved_and_turned_camera() -> None:
    # At (1, 0, 1), looking straight down with the world's x to the right: one point is to the right, the other one up.
    camera = PinholeCamera(41, 31, 80.0, pose((1.0, 0.0, 1.0), np.diag([1.0, -1.0, -1.0])))
    pixels, depth = project(camera, np.array([[1.1, 0.0, 0.0], [1.0, 0.1, 0.2]]))
    np.testing.assert_allclose(pixels, [[28, 15], [20, 5]])
    np.testing.assert_allclose(depth, [1.0, 0.8])


def test_depth_is_along_the_axis_not_along_the_ray() -> None:
    camera = PinholeCamera(41, 31, 80.0, np.eye(4))
    points = back_project(camera, np.array([[20.0, 15.0], [36.0, 31.0]]), np.array([2.0, 2.0]))
    np.testing.assert_allclose(points, [[0, 0, 2], [0.4, 0.4, 2]])


@given(CAMERA, st.lists(st.tuples(st.floats(-50, 700), st.floats(-50, 500), st.floats(0.05, 10)), max_size=4))
def test_project_inverts_back_project(camera: PinholeCamera, rows: list[tuple[float, float, float]]) -> None:
    pixels, depth_m = np.array(rows, float).reshape(-1, 3)[:, :2], np.array(rows, float).reshape(-1, 3)[:, 2]
    projected, depth = project(camera, back_project(camera, pixels, depth_m))
    np.testing.assert_allclose(projected, pixels, atol=1e-6)
    np.testing.assert_allclose(depth, depth_m, rtol=1e-9)


def test_focal_length_of_a_field_of_view() -> None:
    # With a field of view of 90 degrees, the focal length is half the height.
    assert focal_length_px(480, math.pi / 2) == pytest.approx(240)
    # A ray at half the angle meets the image's border, half a pixel beyond the last row's center.
    focal = focal_length_px(480, 0.7)
    camera = PinholeCamera(640, 480, focal, np.eye(4))
    ((_, row),), _ = project(camera, np.array([[0.0, math.tan(0.35), 1.0]]))
    assert row == pytest.approx(479.5)


def test_look_at_gives_known_pixels() -> None:
    # Seen from y = -1, the world's x is to the right and z is up.
    camera = PinholeCamera(41, 31, 80.0, look_at(np.array([0.0, -1.0, 0.0]), np.zeros(3)))
    pixels, depth = project(camera, np.array([[0.0, 0, 0], [0.1, 0, 0], [0, 0, 0.1], [0, 1, 0]]))
    np.testing.assert_allclose(pixels, [[20, 15], [28, 15], [20, 7], [20, 15]], atol=1e-12)
    np.testing.assert_allclose(depth, [1, 1, 1, 2])


def test_look_at_with_clockwise_roll_turns_the_image_counterclockwise() -> None:
    camera = PinholeCamera(41, 31, 80.0, look_at(np.array([0.0, -1.0, 0.0]), np.zeros(3), math.pi / 2))
    pixels, _ = project(camera, np.array([[0.0, 0, 0.1], [0.1, 0, 0]]))
    np.testing.assert_allclose(pixels, [[12, 15], [20, 7]], atol=1e-12)  # up becomes left, right becomes up


@given(
    st.tuples(SMALL, SMALL, st.floats(0.2, 2)).map(np.array),
    st.tuples(st.floats(2, 3), SMALL, SMALL).map(np.array),
    st.floats(-3, 3),
)
def test_look_at_centers_the_target_and_is_right_handed(position: np.ndarray, target: np.ndarray, roll: float) -> None:
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
