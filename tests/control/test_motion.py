"""Motion fields: against finite differences, against ridge regression, and what they need to be told."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from geoskill.control.action import action_space
from geoskill.control.camera_motion import CameraMotion, constant_depth, cross_matrices, point_jacobians
from geoskill.control.estimated_motion import EstimatedMotion
from geoskill.control.exploration import probe_of, probing_moves
from geoskill.control.points_plant import carried_out, points_cameras
from geoskill.geometry.camera import project
from geoskill.geometry.poses import pose, rotation_about, transform

SPACE = action_space("xyzabc")
UPRIGHT = action_space("descent")


def test_cross_matrices() -> None:
    rng = np.random.default_rng(0)
    a, b = rng.normal(size=(2, 5, 3))
    np.testing.assert_allclose(np.einsum("mij,mj->mi", cross_matrices(a), b), np.cross(a, b))


@given(st.integers(0, 10**6))
@settings(max_examples=20, deadline=None)
def test_point_jacobians_are_those_of_finite_differences(seed: int) -> None:
    rng = np.random.default_rng(seed)
    camera = points_cameras(1)[0]
    points, grip = rng.uniform(-0.15, 0.15, (4, 3)), rng.uniform(-0.1, 0.1, 3)
    size = 1e-6
    numeric = np.zeros((4, 2, 6))
    for column in range(6):
        moved = []
        for sign in (1.0, -1.0):
            twist = np.zeros(6)
            twist[column] = sign * size
            body, _ = carried_out(np.eye(4), grip, twist)
            moved.append(project(camera, transform(body, points))[0])
        numeric[:, :, column] = (moved[0] - moved[1]) / (2 * size)
    np.testing.assert_allclose(point_jacobians(camera, points, grip), numeric, rtol=1e-6, atol=1e-4)


def test_interaction_matrix_of_the_textbook() -> None:
    """A camera at the origin that moves sees what a thing that moves against it shows (Chaumette and Hutchinson)."""
    from geoskill.geometry.camera import PinholeCamera

    camera = PinholeCamera(641, 481, 500.0, np.eye(4))
    point = np.array([[0.1, -0.05, 0.5]])
    x, y, depth = 0.2, -0.1, 0.5
    textbook = 500 * np.array(
        [[-1 / depth, 0, x / depth, x * y, -(1 + x**2), y], [0, -1 / depth, y / depth, 1 + y**2, -x * y, -x]]
    )
    # The thing moves about the camera's center, so its twist is the camera's with the opposite sign.
    np.testing.assert_allclose(-point_jacobians(camera, point, np.zeros(3))[0], textbook, atol=1e-9)


def test_calibrated_field_follows_the_grip() -> None:
    camera = points_cameras(1)[0]
    motion = CameraMotion(camera, UPRIGHT, np.zeros(3), constant_depth(0.7))
    moved = motion.observed(np.zeros((0, 2)), np.zeros((0, 2)), np.array([0.01, 0.02, -0.03, 0.5]))
    np.testing.assert_allclose(moved.grip, [0.01, 0.02, -0.03])
    assert motion.jacobian(np.array([[300.0, 200.0]])).shape == (1, 2, 4)


def field_of_a_box(noise: float, rng: np.random.Generator) -> tuple[EstimatedMotion, np.ndarray, np.ndarray]:
    """A field after the probing moves, some points of the thing, and their true Jacobians."""
    camera, body = points_cameras(1)[0], pose((0.02, 0.03, 0.06))
    grip = np.array([0.04, 0.06, 0.09])
    marks = rng.uniform(-1, 1, (12, 3)) * [0.03, 0.05, 0.017]
    probe = probe_of(UPRIGHT)
    motion = EstimatedMotion.prior(UPRIGHT, probe, project(camera, transform(body, marks))[0].mean(axis=0))
    for move in probing_moves(UPRIGHT):
        before = project(camera, transform(body, marks))[0] + noise * rng.normal(size=(12, 2))
        body, grip = carried_out(body, grip, UPRIGHT.basis @ move)
        after = project(camera, transform(body, marks))[0] + noise * rng.normal(size=(12, 2))
        motion = motion.observed(before, after, move)
    world = transform(body, marks)
    return motion, project(camera, world)[0], point_jacobians(camera, world, grip) @ UPRIGHT.basis


def test_exploration_finds_the_field_of_a_box() -> None:
    motion, pixels, true = field_of_a_box(0.5, np.random.default_rng(1))
    estimated = motion.jacobian(pixels)
    # In a step at the limit of every axis, the error of the prediction in pixels.
    errors = np.abs((estimated - true) * UPRIGHT.step).max(axis=(0, 1))
    assert (errors < 2.0).all(), errors
    assert np.linalg.norm(motion.theta[:, :4]) > 500


def test_without_process_noise_it_is_ridge_regression(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("geoskill.control.estimated_motion.DRIFT", 0.0)
    monkeypatch.setattr("geoskill.control.estimated_motion.GATE", 1e9)
    monkeypatch.setattr(EstimatedMotion, "recentered", lambda self, center: self)
    rng = np.random.default_rng(2)
    probe = probe_of(UPRIGHT)
    motion = EstimatedMotion.prior(UPRIGHT, probe, np.array([300.0, 200.0]))
    rows, targets = [], []
    for _ in range(6):
        action = probe * rng.uniform(-1, 1, 4)
        before = rng.uniform(100, 400, (5, 2))
        after = before + rng.normal(0, 5, (5, 2))
        phi = np.column_stack([np.ones(5), (before - [300.0, 200.0]) / 60])
        rows.append(np.stack([np.kron(own, action) for own in phi]))
        targets.append(after - before)
        motion = motion.observed(before, after, action)
    h, y = np.concatenate(rows), np.concatenate(targets)
    std = np.concatenate([[900, 900, 900, 60], np.tile([270, 270, 270, 18], 2)])
    ridge = np.linalg.solve(h.T @ h / 0.59 + np.diag(1 / std**2), h.T @ y / 0.59).T
    np.testing.assert_allclose(motion.theta, ridge, rtol=1e-8, atol=1e-8)


def test_another_center_is_the_same_field() -> None:
    motion, pixels, _ = field_of_a_box(0.3, np.random.default_rng(3))
    other = motion.recentered(motion.center + np.array([37.0, -81.0]))
    np.testing.assert_allclose(other.jacobian(pixels), motion.jacobian(pixels), atol=1e-9)
    back = other.recentered(motion.center)
    np.testing.assert_allclose(back.covariance, motion.covariance, rtol=1e-6, atol=1e-6)


def test_what_does_not_fit_is_left_out_and_small_moves_say_nothing() -> None:
    motion, pixels, true = field_of_a_box(0.3, np.random.default_rng(4))
    action = np.array([0.01, 0.0, 0.0, 0.0])
    jump = pixels + 50.0
    assert motion.observed(pixels, jump, action) is motion
    assert motion.observed(pixels, pixels, 0.001 * action) is motion
    assert motion.observed(pixels[:0], pixels[:0], action) is motion
    assert motion.observed(pixels, pixels, np.array([math.nan, 0.0, 0.0, 0.0])) is motion
    after = pixels + (true @ action)
    mixed = np.concatenate([after[:8], pixels[8:] + 50.0])
    kept = motion.observed(pixels, mixed, action)
    np.testing.assert_allclose(kept.theta, motion.observed(pixels[:8], after[:8], action).theta)


def test_turn_about_the_grip_needs_the_affine_part() -> None:
    """With one Jacobian for all points, two sides of a thing would move alike; turned, they move against each other."""
    motion, pixels, true = field_of_a_box(0.0, np.random.default_rng(5))
    turn = true[:, :, 3]
    assert np.ptp(turn, axis=0).max() > 50
    residual = motion.jacobian(pixels)[:, :, 3] - turn
    assert np.abs(residual).max() < 0.2 * np.ptp(turn, axis=0).max()
    assert rotation_about(np.array([0.0, 0.0, 0.1])).shape == (3, 3)
