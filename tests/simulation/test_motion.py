"""Motion of the object from start to goal."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from geoskill.geometry.poses import rotation_about, rotation_vector, table_pose
from geoskill.simulation.motion import HOLD, PathSpec, ScriptedMotion, human_motion, minimum_jerk, robot_motion

START, GOAL = table_pose(0.2, -0.1, 0.4, 0.02), table_pose(-0.1, 0.05, -0.6, 0.03)
PATH = PathSpec(START, GOAL, approach=np.array([0.0, 0.0, 0.05]), height=0.08)
FRAMES = range(80, 111)  # a recording has one of these lengths


def human(seed: int = 0, frames: int = 90, confidence: float = 0.93) -> ScriptedMotion:
    return human_motion(PATH, frames, confidence, np.random.default_rng(seed))


def length_m(motion: ScriptedMotion) -> float:
    return float(np.linalg.norm(np.diff(motion.object_poses[:, :3, 3], axis=0), axis=1).sum())


def test_minimum_jerk_has_the_values_of_its_polynomial() -> None:
    # 10/64 - 15/256 + 6/1024.
    np.testing.assert_allclose(minimum_jerk(np.array([0, 0.25, 0.5, 0.75, 1])), [0, 0.103515625, 0.5, 0.896484375, 1])
    # Speed and acceleration vanish at both ends: a hundredth of the time makes 10 millionths of the progress.
    np.testing.assert_allclose(minimum_jerk(np.array([0.01, 0.99])), [9.85e-6, 1 - 9.85e-6], atol=1e-8)
    assert np.all(np.diff(minimum_jerk(np.linspace(0, 1, 100))) > 0)


@pytest.mark.slow
@pytest.mark.parametrize("confidence", [0.05, 0.93, 1.0])
def test_human_motion_begins_at_the_start_and_ends_at_the_goal(confidence: float) -> None:
    for frames in FRAMES:
        motion = human(frames, frames, confidence)
        assert len(motion.object_poses) == len(motion.held) == len(motion.opening) == len(motion.retreat_m) == frames
        np.testing.assert_allclose(motion.object_poses[0], START, atol=1e-9)
        np.testing.assert_allclose(motion.object_poses[-1], GOAL, atol=1e-9)


def test_robot_motion_begins_at_the_start_and_ends_at_the_goal() -> None:
    for frames in FRAMES:
        motion = robot_motion(PATH, frames)
        assert len(motion.object_poses) == frames
        np.testing.assert_allclose(motion.object_poses[0], START, atol=1e-9)
        np.testing.assert_allclose(motion.object_poses[-1], GOAL, atol=1e-9)


def test_released_object_stays_at_the_goal() -> None:
    for frames in FRAMES:
        for motion in (robot_motion(PATH, frames), human(frames, frames)):
            free = ~motion.held
            assert motion.held[0]
            assert 3 <= free.sum() < 0.2 * frames
            assert np.all(np.diff(motion.held.astype(int)) <= 0)  # never grasped again
            # The smooth end of the motion may still lower it minimally.
            assert np.abs(motion.object_poses[free] - GOAL).max() < 1e-3
            np.testing.assert_array_equal(motion.held, motion.opening == 0)
            assert np.all(np.diff(motion.opening) >= 0)
            assert motion.opening[-1] == 1
            assert np.all(np.diff(motion.retreat_m) >= 0)
            assert np.all(motion.retreat_m[motion.opening < 1] == 0)
            assert motion.retreat_m[-1] > 0.03


def test_robot_motion_follows_the_path_specification() -> None:
    motion = robot_motion(PATH, 100)
    positions, rotations = motion.object_poses[:, :3, 3], motion.object_poses[:, :3, :3]
    held = round(HOLD * 100)
    np.testing.assert_array_equal(motion.object_poses[:held], np.repeat(START[None], held, axis=0))
    # Halfway, the cubic's inner control points, 8 cm above its higher end, have a weight of 3/4, and its ends the rest.
    assert positions[:, 2].max() == pytest.approx(0.75 * (0.08 + 0.08) + 0.25 * (0.02 + 0.08) / 2, abs=0.003)
    # The final segment is straight down, and the object has turned before it.
    last = positions[67:, :]
    np.testing.assert_allclose(last[:, :2], np.repeat(GOAL[None, :2, 3], len(last), axis=0), atol=1e-9)
    assert np.all(np.diff(last[:, 2]) <= 0)
    np.testing.assert_allclose(rotations[67:], np.repeat(GOAL[None, :3, :3], 33, axis=0), atol=1e-9)
    # It turns about the vertical only, always in the same direction.
    yaw = np.unwrap([rotation_vector(rotation)[2] for rotation in rotations])
    assert np.all(np.diff(yaw) <= 1e-12)
    assert yaw[0] - yaw[-1] == pytest.approx(1.0)


def test_human_motion_depends_on_the_seed() -> None:
    np.testing.assert_array_equal(human(1).object_poses, human(1).object_poses)
    assert np.abs(human(1).object_poses - human(2).object_poses).max() > 0.01


def test_human_path_is_longer_at_lower_confidence() -> None:
    high, usual, low = (
        np.array([length_m(human(seed, confidence=confidence)) for seed in range(12)])
        for confidence in (1.0, 0.93, 0.5)
    )
    assert np.all(high < low)
    assert high.mean() < usual.mean() < low.mean()


def test_human_motion_has_tremor_and_robot_motion_none() -> None:
    def roughness(motion: ScriptedMotion) -> float:
        carried = motion.object_poses[8:60, :3, 3]
        return float(np.linalg.norm(np.diff(carried, n=3, axis=0), axis=1).mean())

    assert roughness(human()) > 3 * roughness(robot_motion(PATH, 90))


@given(st.tuples(st.floats(-1, 1), st.floats(-1, 1), st.floats(0.1, 0.4)), st.sampled_from(FRAMES))
def test_path_passes_its_detour(detour: tuple[float, float, float], frames: int) -> None:
    point = np.array(detour)
    motion = robot_motion(PathSpec(START, GOAL, PATH.approach, PATH.height, point), frames)
    np.testing.assert_allclose(motion.object_poses[0], START, atol=1e-9)
    np.testing.assert_allclose(motion.object_poses[-1], GOAL, atol=1e-9)
    assert np.linalg.norm(motion.object_poses[:, :3, 3] - point, axis=1).min() < 0.02


def test_object_turns_by_the_smaller_angle() -> None:
    start = table_pose(0.2, 0, math.radians(170), 0.02)
    goal = table_pose(-0.1, 0, math.radians(-170), 0.02)
    object_poses = robot_motion(PathSpec(start, goal, PATH.approach, PATH.height), 90).object_poses
    half = rotation_about(np.array([0, 0, math.pi]))
    assert max(
        np.linalg.norm(rotation_vector(half.T @ object_pose[:3, :3])) for object_pose in object_poses
    ) < math.radians(10.1)
