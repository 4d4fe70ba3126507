"""The ways from start to goal."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from geoskill.geometry.poses import rotation_about, rotation_vector, table_pose
from geoskill.simulation.motion import HOLD, ScriptedMotion, PathSpec, human_motion, minimum_jerk, robot_motion

START, GOAL = table_pose(0.2, -0.1, 0.4, 0.02), table_pose(-0.1, 0.05, -0.6, 0.03)
WAY = PathSpec(START, GOAL, approach=np.array([0.0, 0.0, 0.05]), height=0.08)
FRAMES = range(80, 111)  # of which a recording draws one


def human(seed: int = 0, frames: int = 90, confidence: float = 0.93) -> ScriptedMotion:
    return human_motion(WAY, frames, confidence, np.random.default_rng(seed))


def length_m(motion: ScriptedMotion) -> float:
    return float(np.linalg.norm(np.diff(motion.led[:, :3, 3], axis=0), axis=1).sum())


def test_minimum_jerk_by_hand() -> None:
    # 10/64 - 15/256 + 6/1024.
    np.testing.assert_allclose(minimum_jerk(np.array([0, 0.25, 0.5, 0.75, 1])), [0, 0.103515625, 0.5, 0.896484375, 1])
    # Speed and acceleration vanish at both ends: a hundredth of the time makes 10 millionths of the way.
    np.testing.assert_allclose(minimum_jerk(np.array([0.01, 0.99])), [9.85e-6, 1 - 9.85e-6], atol=1e-8)
    assert np.all(np.diff(minimum_jerk(np.linspace(0, 1, 100))) > 0)


@pytest.mark.parametrize("confidence", [0.05, 0.93, 1.0])
def test_a_person_begins_at_the_start_and_ends_at_the_goal(confidence: float) -> None:
    for frames in FRAMES:
        motion = human(frames, frames, confidence)
        assert len(motion.led) == len(motion.held) == len(motion.opening) == len(motion.retreat) == frames
        np.testing.assert_allclose(motion.led[0], START, atol=1e-9)
        np.testing.assert_allclose(motion.led[-1], GOAL, atol=1e-9)


def test_a_robot_begins_at_the_start_and_ends_at_the_goal() -> None:
    for frames in FRAMES:
        motion = robot_motion(WAY, frames)
        assert len(motion.led) == frames
        np.testing.assert_allclose(motion.led[0], START, atol=1e-9)
        np.testing.assert_allclose(motion.led[-1], GOAL, atol=1e-9)


def test_what_is_let_go_lies_where_it_belongs() -> None:
    for frames in FRAMES:
        for motion in (robot_motion(WAY, frames), human(frames, frames)):
            free = ~motion.held
            assert motion.held[0]
            assert 3 <= free.sum() < 0.2 * frames
            assert np.all(np.diff(motion.held.astype(int)) <= 0)  # never taken again
            # It may still sink by the last bit of a smooth end.
            assert np.abs(motion.led[free] - GOAL).max() < 1e-3
            np.testing.assert_array_equal(motion.held, motion.opening == 0)
            assert np.all(np.diff(motion.opening) >= 0)
            assert motion.opening[-1] == 1
            assert np.all(np.diff(motion.retreat) >= 0)
            assert np.all(motion.retreat[motion.opening < 1] == 0)
            assert motion.retreat[-1] > 0.03


def test_a_robots_way_by_hand() -> None:
    motion = robot_motion(WAY, 100)
    places, turns = motion.led[:, :3, 3], motion.led[:, :3, :3]
    held = round(HOLD * 100)
    np.testing.assert_array_equal(motion.led[:held], np.repeat(START[None], held, axis=0))
    # The cubic's inner control points are 8 cm over its higher end, and count for 3/4 halfway, the ends for the rest.
    assert places[:, 2].max() == pytest.approx(0.75 * (0.08 + 0.08) + 0.25 * (0.02 + 0.08) / 2, abs=0.003)
    # The last stretch is straight down, and the thing has turned before it.
    last = places[67:, :]
    np.testing.assert_allclose(last[:, :2], np.repeat(GOAL[None, :2, 3], len(last), axis=0), atol=1e-9)
    assert np.all(np.diff(last[:, 2]) <= 0)
    np.testing.assert_allclose(turns[67:], np.repeat(GOAL[None, :3, :3], 33, axis=0), atol=1e-9)
    # It turns about the vertical only, all the way the same way round.
    yaw = np.unwrap([rotation_vector(turn)[2] for turn in turns])
    assert np.all(np.diff(yaw) <= 1e-12)
    assert yaw[0] - yaw[-1] == pytest.approx(1.0)


def test_the_same_seed_makes_the_same_way_and_any_other_another_one() -> None:
    np.testing.assert_array_equal(human(1).led, human(1).led)
    assert np.abs(human(1).led - human(2).led).max() > 0.01


def test_less_confidence_makes_a_longer_way() -> None:
    sure, usual, unsure = (
        np.array([length_m(human(seed, confidence=confidence)) for seed in range(12)])
        for confidence in (1.0, 0.93, 0.5)
    )
    assert np.all(sure < unsure)
    assert sure.mean() < usual.mean() < unsure.mean()


def test_a_hand_trembles_and_a_robot_does_not() -> None:
    def roughness(motion: ScriptedMotion) -> float:
        carried = motion.led[8:60, :3, 3]
        return float(np.linalg.norm(np.diff(carried, n=3, axis=0), axis=1).mean())

    assert roughness(human()) > 3 * roughness(robot_motion(WAY, 90))


@given(st.tuples(st.floats(-1, 1), st.floats(-1, 1), st.floats(0.1, 0.4)), st.sampled_from(FRAMES))
def test_a_detour_is_passed(detour: tuple[float, float, float], frames: int) -> None:
    place = np.array(detour)
    motion = robot_motion(PathSpec(START, GOAL, WAY.approach, WAY.height, place), frames)
    np.testing.assert_allclose(motion.led[0], START, atol=1e-9)
    np.testing.assert_allclose(motion.led[-1], GOAL, atol=1e-9)
    assert np.linalg.norm(motion.led[:, :3, 3] - place, axis=1).min() < 0.02


def test_the_longer_way_round_is_not_taken() -> None:
    start = table_pose(0.2, 0, math.radians(170), 0.02)
    goal = table_pose(-0.1, 0, math.radians(-170), 0.02)
    led = robot_motion(PathSpec(start, goal, WAY.approach, WAY.height), 90).led
    half = rotation_about(np.array([0, 0, math.pi]))
    assert max(np.linalg.norm(rotation_vector(half.T @ turn[:3, :3])) for turn in led) < math.radians(10.1)
