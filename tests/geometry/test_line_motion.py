"""Rigid motions found through one line, among wrong matches and a background that moved otherwise."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from geoskill.geometry.line_motion import anchored_line_motion, lines_agree

TURN, SHIFT = Rotation.from_rotvec([0.1, -0.2, 0.5]).as_matrix(), np.array([0.05, -0.02, 0.04])
TOLERANCE_M = 0.008


def lines(count: int, seed: int, spread: float) -> np.ndarray:
    random = np.random.default_rng(seed)
    middle = random.uniform(-spread, spread, (count, 3)) + np.array([0.0, 0.0, 0.7])
    way = random.normal(size=(count, 3))
    arm = 0.04 * way / np.linalg.norm(way, axis=1, keepdims=True)
    return np.hstack([middle - arm, middle + arm])


def moved(rows: np.ndarray) -> np.ndarray:
    return (rows.reshape(-1, 2, 3) @ TURN.T + SHIFT).reshape(-1, 6)


def seen_again(rows: np.ndarray, seed: int) -> np.ndarray:
    """Return lines that a detector ends elsewhere, and some of them the other way round."""
    random = np.random.default_rng(seed)
    way = rows[:, 3:] - rows[:, :3]
    cut = random.uniform(0, 0.3, (len(rows), 2))
    ends = np.hstack([rows[:, :3] + cut[:, :1] * way, rows[:, 3:] - cut[:, 1:] * way])
    turned = random.random(len(rows)) < 0.5
    return np.where(turned[:, None], np.roll(ends, 3, axis=1), ends)


@pytest.mark.parametrize("noise_m", [0.0, 0.001])
def test_motion_of_the_anchors_thing_wins_over_a_larger_background(noise_m: float) -> None:
    own, background = lines(7, 0, 0.06), lines(20, 1, 0.3)
    source = np.concatenate([own[1:], background, own[1:4]])
    target = np.concatenate([moved(own[1:]), background, lines(3, 2, 0.1)])
    feature = np.concatenate([np.arange(26), np.arange(3)])
    target = seen_again(target, 3) + np.random.default_rng(4).normal(0, noise_m, target.shape)
    motion = anchored_line_motion((own[0], seen_again(moved(own[:1]), 5)[0]), source, target, feature, TOLERANCE_M)
    assert motion is not None
    np.testing.assert_allclose(motion[:3, :3] @ motion[:3, :3].T, np.eye(3), atol=1e-12)
    assert np.linalg.det(motion[:3, :3]) == pytest.approx(1.0)
    places = own.reshape(-1, 3)
    offset = places @ TURN.T + SHIFT - (places @ motion[:3, :3].T + motion[:3, 3])
    assert np.linalg.norm(offset, axis=1).max() < (1e-9 if noise_m == 0 else 0.010)


def test_too_few_and_parallel_lines_say_nothing() -> None:
    own = lines(6, 0, 0.06)
    anchor = own[0], moved(own[:1])[0]
    assert anchored_line_motion(anchor, own[1:2], moved(own[1:2]), np.arange(1), TOLERANCE_M) is None
    beside = own[0] + 0.02 * np.arange(1, 6)[:, None] * np.tile([0.0, 1.0, 0.5], 2)
    assert anchored_line_motion(anchor, beside, moved(beside), np.arange(5), TOLERANCE_M) is None
    none = np.zeros((0, 6))
    assert anchored_line_motion(anchor, none, none, np.zeros(0, np.int64), TOLERANCE_M) is None


def test_a_frame_that_looks_the_same_upside_down_says_nothing() -> None:
    # A square, whose sides agree after half a turn, too; but for where the fourth corner is known, a box's edge.
    corners = np.array([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]) * 0.04 + [0.0, 0.0, 0.7]
    square = np.hstack([corners, np.roll(corners, -1, axis=0)])
    mixed = np.array([3, 2, 1])  # every side may be any other one
    source, target = np.concatenate([square[1:]] * 2), np.concatenate([square[1:], square[mixed]])
    feature = np.concatenate([np.arange(3), np.arange(3)])
    anchor = square[0], square[0]
    assert anchored_line_motion(anchor, source, target, feature, TOLERANCE_M) is None
    edge = np.array([[-0.04, -0.04, 0.7, -0.04, -0.04, 0.6]])
    motion = anchored_line_motion(
        anchor, np.vstack([source, edge]), np.vstack([target, edge]), np.append(feature, 3), TOLERANCE_M
    )
    np.testing.assert_allclose(motion, np.eye(4), atol=1e-9)


def test_lines_agree_in_direction_place_and_reach() -> None:
    line = np.array([[0.0, 0.0, 0.7, 0.1, 0.0, 0.7]])
    shifted = line + np.tile([0.0, 0.007, 0.0], 2)
    far = line + np.tile([0.0, 0.009, 0.0], 2)
    along = line + np.tile([0.12, 0.0, 0.0], 2)
    turned = np.array([[0.0, 0.0, 0.7, 0.1, 0.012, 0.7]])
    targets = np.vstack([shifted, far, along, turned, np.roll(line, 3)])
    agrees = lines_agree(np.repeat(line, 5, axis=0), targets, np.eye(4), TOLERANCE_M)
    assert agrees.tolist() == [True, False, False, False, True]
