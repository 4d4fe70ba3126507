"""The way down: the height that is left, what is no support, and features that do not move together."""

from dataclasses import replace

import numpy as np
import pytest

from geoskill.control.action import action_space
from geoskill.control.camera_motion import CameraMotion, constant_depth
from geoskill.control.descent import SWEEP_FRAMES, SWEEP_M, Descent, guided_down
from geoskill.control.law import Height, step_of
from geoskill.control.perceive import moves_together
from geoskill.control.points_plant import points_cameras
from geoskill.control.rows import rows_of
from geoskill.control.settings import ServoConfig
from geoskill.geometry.camera import project
from tests.control.small_loops import pair

SPACE = action_space("descent")
DRIVEN = [0, 1, 3]


def test_height_is_seen_from_the_scale_whatever_was_believed_of_it() -> None:
    """A thing that is 20 mm above its goal and 5 mm aside."""
    (camera,) = points_cameras(1)
    goal = np.array([[x, y, 0.04] for x in (-0.05, 0.0, 0.05) for y in (-0.05, 0.0, 0.05)])
    present, depth = project(camera, goal + np.array([0.005, 0.0, 0.020]))
    motion = CameraMotion(camera, SPACE, np.array([0.0, 0.0, 0.06]), lambda points: depth[: len(points)])
    places = project(camera, goal)[0]
    rows = [
        row
        for number, (now, place) in enumerate(zip(present, places, strict=True))
        for row in rows_of(
            [pair(tuple(now), tuple(place))], [replace(motion, depth_of=constant_depth(float(depth[number])))]
        )
    ]
    for ahead_m in (0.0, -0.02, -0.05):
        step = step_of(rows, SPACE, DRIVEN, np.zeros(4), 1.0, np.array([0.0, 0.0, ahead_m, 0.0]))
        assert step.height.left_m == pytest.approx(-0.020, abs=0.0015)
        assert 0.001 < step.height.std_m < 0.02
        if ahead_m == -0.02:  # aimed at from above, the goal is 5 mm aside, and nothing else
            assert step.rms < 8
            assert step.action[:2] * 1000 == pytest.approx([-5, 0], abs=0.4)
    assert step_of(rows, SPACE, DRIVEN, np.zeros(4), 1.0).height == Height()


def test_estimate_forgets_what_was_seen_from_afar() -> None:
    descent = Descent()
    assert descent.ahead_m(0.0, 0.3) == 0.0
    for _ in range(3):
        descent = descent.seen(0.0, Height(-0.10, 0.05))
    for _ in range(20):
        descent = descent.seen(-0.02, Height(-0.04, 0.005))
    assert descent.bottom_m == pytest.approx(-0.06, abs=1e-4)
    assert descent.std_m == pytest.approx(0.005, rel=0.02)
    assert descent.ahead_m(-0.02, 0.3) == pytest.approx(-0.04, rel=0.04)
    assert descent.ahead_m(-0.02, 0.01) == -0.01  # as far as the limits allow
    assert descent.ahead_m(-0.09, 0.3) == 0.0  # never up
    assert descent.seen(0.0, Height()) == descent


def sighted(left_m: float) -> Descent:
    descent = Descent()
    for _ in range(30):
        descent = descent.seen(0.0, Height(left_m, 0.004))
    return descent


def test_what_stops_far_above_the_goal_is_no_support() -> None:
    config, rest = ServoConfig(), np.zeros(4)
    guided, on_support = guided_down(config, SPACE, sighted(-0.004), rest, 1.0, True)
    assert guided.at_support
    assert on_support.landed
    assert not guided.action.any()
    descent = sighted(-0.034)
    aims = []
    for _ in range(SWEEP_FRAMES[-1]):
        guided, descent = guided_down(config, SPACE, descent, rest, 1.0, True)
        assert guided.action.tolist() == [0, 0, -0.001, 0]  # it presses lightly
        aims.append(float(guided.ahead[2]))
    assert (min(aims), max(aims)) == pytest.approx((-0.034 - SWEEP_FRAMES[0] * SWEEP_M, -0.034), abs=0.002)
    guided, descent = guided_down(config, SPACE, descent, rest, 1.0, True)
    assert descent.is_stuck
    assert not descent.landed


def test_way_down_is_slow_while_the_error_is_large() -> None:
    def speed(rms: float) -> float:
        return float(guided_down(ServoConfig(), SPACE, Descent(), np.zeros(4), rms, False)[0].action[2])

    assert speed(1.0) == pytest.approx(-0.006)
    assert speed(8.0) == pytest.approx(-0.003)
    assert speed(30.0) == 0.0


def test_shadows_do_not_move_together_with_the_thing() -> None:
    rng = np.random.default_rng(0)
    before = rng.uniform(100, 300, (40, 2))
    after = before + np.array([9.0, -4.0]) + 0.03 * (before - 200) + rng.normal(0, 0.3, (40, 2))
    after[30:] = before[30:] + np.array([4.0, 3.0])
    carried = np.ones(40, bool)
    carried[0] = False
    together = moves_together(before, after, carried)
    assert not together[0]
    assert together[1:30].mean() > 0.9
    assert not together[30:].any()
    few = np.arange(40) < 5
    np.testing.assert_array_equal(moves_together(before, after, few), few)
