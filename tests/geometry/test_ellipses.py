"""Distance to an ellipse: the conic's own matrix and the exact distance as references."""

import cv2
import numpy as np
import pytest
import torch

from geoskill.geometry.ellipses import ellipse_of_axes, point_to_ellipse, semi_axes

CENTER, AXES, ANGLE = (130.0, 90.0), (50.0, 24.0), 0.6
ELLIPSE = torch.from_numpy(ellipse_of_axes(CENTER, AXES, ANGLE))[None]


def conic() -> np.ndarray:
    """Matrix C of the ellipse with xᵀCx = 0 (Hartley and Zisserman, section 2.2.3)."""
    cosine, sine = np.cos(ANGLE), np.sin(ANGLE)
    to_ellipse = np.array([[cosine, sine, 0], [-sine, cosine, 0], [0, 0, 1]]) @ np.array(
        [[1, 0, -CENTER[0]], [0, 1, -CENTER[1]], [0, 0, 1]]
    )
    return to_ellipse.T @ np.diag([AXES[0] ** -2.0, AXES[1] ** -2.0, -1]) @ to_ellipse


def outline(count: int = 4000, scale: float = 1.0) -> np.ndarray:
    t = np.linspace(0, 2 * np.pi, count, endpoint=False)
    own = np.stack([AXES[0] * np.cos(t), AXES[1] * np.sin(t)], axis=1) * scale
    turn = np.array([[np.cos(ANGLE), -np.sin(ANGLE)], [np.sin(ANGLE), np.cos(ANGLE)]])
    return own @ turn.T + CENTER


def error_at(points: np.ndarray, ellipse: torch.Tensor = ELLIPSE) -> np.ndarray:
    return point_to_ellipse(torch.from_numpy(points), ellipse.repeat(len(points), 1))[:, 0].numpy()


def test_error_is_sampsons_distance_of_the_conic() -> None:
    points = np.random.default_rng(0).uniform((60, 30), (200, 150), (100, 2))
    points = points[np.linalg.norm(points - CENTER, axis=1) > 35]
    homogeneous = np.column_stack([points, np.ones(len(points))])
    product = homogeneous @ conic()
    expected = (product * homogeneous).sum(axis=1) / np.linalg.norm(2 * product[:, :2], axis=1)
    np.testing.assert_allclose(error_at(points), expected, rtol=1e-9)


def test_error_is_zero_on_the_outline_and_the_distance_near_it() -> None:
    assert np.abs(error_at(outline(60))).max() < 1e-12
    near = outline(60, 1.02)
    exact = np.linalg.norm(near[:, None] - outline()[None], axis=2).min(axis=1)
    np.testing.assert_allclose(error_at(near), exact, rtol=0.05)
    assert (error_at(outline(60, 0.98)) < 0).all()


def test_error_inside_is_bounded_by_the_semi_major_axis() -> None:
    inside = np.concatenate([outline(50, share) for share in (0.0, 0.001, 0.1, 0.5, 0.9)])
    error = error_at(inside)
    assert (error < 0).all()
    assert error.min() == pytest.approx(-AXES[0])


def test_conjugate_diameters_of_an_affine_map_are_its_ellipse() -> None:
    shear = torch.tensor([[1.2, 0.3], [-0.1, 0.8]], dtype=torch.float64)
    mapped = (ELLIPSE.reshape(4, 2) @ shear.T).reshape(1, 8)
    assert np.abs(error_at(outline(60) @ shear.numpy().T, mapped)).max() < 1e-12
    # The same ellipse by its axes, as OpenCV finds them.
    (x, y), (width, height), degrees = cv2.fitEllipseDirect((outline(60) @ shear.numpy().T).astype(np.float32))
    np.testing.assert_allclose(semi_axes(mapped)[0], sorted([width / 2, height / 2], reverse=True), rtol=1e-4)
    by_axes = torch.from_numpy(ellipse_of_axes((x, y), (width / 2, height / 2), np.radians(degrees)))[None]
    assert np.abs(error_at(outline(60) @ shear.numpy().T, by_axes)).max() < 1e-3


@pytest.mark.parametrize("axes", [(2.9, 2.0), (40.0, 0.1), (0.0, 0.0)])
def test_a_dot_or_a_stroke_is_never_reached(axes: tuple[float, float]) -> None:
    ellipse = torch.from_numpy(ellipse_of_axes((10.0, 10.0), axes, 0.3))[None].requires_grad_()
    point = torch.tensor([[13.0, 14.0]], dtype=torch.float64, requires_grad=True)
    error = point_to_ellipse(point, ellipse)
    assert float(error.detach()) == pytest.approx(5.0)
    assert all(own.isfinite().all() for own in torch.autograd.grad(error.sum(), [point, ellipse]))


def test_gradient_is_that_of_finite_differences() -> None:
    points = torch.from_numpy(np.random.default_rng(0).uniform((60, 30), (200, 150), (6, 2))).requires_grad_()
    assert torch.autograd.gradcheck(point_to_ellipse, [points, ELLIPSE.repeat(6, 1).requires_grad_()])
