"""Rigid motions found through one point, among wrong matches and a background that moved otherwise."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from geoskill.geometry.rigid_map import anchored_motion, fitted_motion

TURN, SHIFT = Rotation.from_rotvec([0.1, -0.2, 0.5]).as_matrix(), np.array([0.05, -0.02, 0.04])
TOLERANCE_M = 0.008


def thing(count: int) -> np.ndarray:
    points = np.random.default_rng(0).uniform(-0.06, 0.06, (count, 3))
    return points + np.array([0.0, 0.0, 0.7])


def moved(points: np.ndarray) -> np.ndarray:
    return points @ TURN.T + SHIFT


def test_fit_agrees_with_scipy() -> None:
    points = thing(12)
    noisy = moved(points) + np.random.default_rng(1).normal(0, 0.002, points.shape)
    motion = fitted_motion(points, noisy)
    expected, _ = Rotation.align_vectors(noisy - noisy.mean(axis=0), points - points.mean(axis=0))
    np.testing.assert_allclose(motion[:3, :3], expected.as_matrix(), atol=1e-9)
    np.testing.assert_allclose(motion[:3, :3] @ points.mean(axis=0) + motion[:3, 3], noisy.mean(axis=0), atol=1e-12)
    assert np.linalg.det(motion[:3, :3]) == pytest.approx(1.0)


@pytest.mark.parametrize("noise_m", [0.0, 0.0018])
def test_motion_of_the_anchors_thing_wins_over_a_larger_background(noise_m: float) -> None:
    random = np.random.default_rng(2)
    own, background = thing(9), random.uniform(-0.3, 0.3, (40, 3)) + np.array([0, 0, 0.7])
    source = np.concatenate([own[1:], background, own[1:5]])
    target = np.concatenate([moved(own[1:]), background, random.uniform(-0.1, 0.1, (4, 3)) + np.array([0, 0, 0.7])])
    feature = np.concatenate([np.arange(48), np.arange(4)])
    target = target + random.normal(0, noise_m, target.shape)
    motion = anchored_motion((own[0], moved(own)[0]), source, target, feature, TOLERANCE_M)
    offset = moved(own) - (own @ motion[:3, :3].T + motion[:3, 3])
    assert np.linalg.norm(offset, axis=1).max() < (1e-9 if noise_m == 0 else 0.004)


def test_too_few_or_collinear_points_say_nothing() -> None:
    own = thing(6)
    two = slice(1, 3)
    assert anchored_motion((own[0], moved(own)[0]), own[two], moved(own)[two], np.arange(2), TOLERANCE_M) is None
    line = own[0] + np.linspace(0.01, 0.1, 8)[:, None] * [1.0, 0, 0]
    assert anchored_motion((own[0], moved(own)[0]), line, moved(line), np.arange(8), TOLERANCE_M) is None
    none = np.zeros((0, 3))
    assert anchored_motion((own[0], own[0]), none, none, np.zeros(0, np.int64), TOLERANCE_M) is None
