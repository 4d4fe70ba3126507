"""The field of a camera of which the intrinsics are known."""

import numpy as np
import pytest

from geoskill.control.camera_motion import constant_depth, point_jacobians
from geoskill.exports.intrinsics import IntrinsicMotion, interaction_matrices, measured_depth, normalized
from geoskill.geometry.camera import PinholeCamera
from geoskill.geometry.depth_camera import DepthCamera
from geoskill.geometry.depth_picture import DepthPicture
from geoskill.geometry.poses import rotation_about
from tests.exports.conftest import CAMERA, DEPTH_M


def test_field_is_what_a_moved_point_does(motion: IntrinsicMotion) -> None:
    """Finite differences of the projection of a thing that is moved by a small twist about the camera's center."""
    pixels = np.array([[101.5, 66.0], [420.0, 310.0]])
    points = CAMERA.back_project(pixels, np.full(2, DEPTH_M))
    found = motion.jacobian(pixels)
    for component, step in enumerate(1e-6 * np.eye(6)):
        moved = points @ rotation_about(step[3:]).T + step[:3]
        slope = (CAMERA.project(moved) - pixels) / 1e-6
        np.testing.assert_allclose(found[:, :, component], slope, rtol=1e-4, atol=1e-3)


def test_field_agrees_with_that_of_a_camera_at_the_origin() -> None:
    camera = PinholeCamera(641, 481, 500.0, np.eye(4))
    own = IntrinsicMotion(DepthCamera(500.0, 500.0, 320.0, 240.0), constant_depth(0.5))
    points = np.array([[0.1, -0.05, 0.5], [-0.12, 0.2, 0.5]])
    pixels = 500 * points[:, :2] / 0.5 + [320, 240]
    np.testing.assert_allclose(
        own.jacobian(pixels), point_jacobians(camera, points, np.zeros(3)), rtol=1e-12, atol=1e-9
    )


def test_worked_number_of_the_toolbox() -> None:
    """Of the documentation of CentralCamera.visjac_p: the default camera, the pixel (200, 300), 2 m away.

    https://petercorke.github.io/machinevision-toolbox-python (visjac_p); f = 8 mm, pixels of 10 um, 1000 x 1000.
    """
    camera = DepthCamera(800.0, 800.0, 500.0, 500.0)
    matrix = 800 * interaction_matrices(normalized(camera, np.array([[200.0, 300.0]])), np.array([2.0]))[0]
    expected = [[-400.0, 0.0, -150.0, 75.0, -912.5, -200.0], [0.0, -400.0, -100.0, 850.0, -75.0, 300.0]]
    np.testing.assert_allclose(matrix, expected, atol=1e-9)


def test_depth_is_looked_up_and_replaced_where_there_is_none() -> None:
    depth = np.full((4, 6), 0.5, np.float32)
    depth[1, 2], depth[3, 5] = 0.75, np.nan
    depths = measured_depth(DepthPicture(depth, CAMERA), 0.9)
    found = depths(np.array([[2.3, 0.8], [5.0, 3.0], [-7.0, 0.0], [99.0, 99.0]]))
    assert found.tolist() == pytest.approx([0.75, 0.9, 0.5, 0.9])
