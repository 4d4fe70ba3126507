"""Conditions: refused values, placement ranges and the camera's motion."""

import math
from typing import Any

import numpy as np
import pytest

from geoskill.config import ScenarioConfig
from geoskill.errors import InputError
from geoskill.geometry.camera import PinholeCamera, project
from geoskill.geometry.poses import rotation_vector
from geoskill.simulation.conditions import (
    RANDOM_TARGET_RANGE,
    USUAL_TARGET_RANGE,
    camera_trajectory,
    pan_aside,
    target_range,
)
from geoskill.simulation.tasks.task import PlacementRange, PlanarPose


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"actor": "dog"}, "actor=dog: expected human or robot"),
        ({"confidence": 0.0}, "confidence=0.0: expected a number above 0 and at most 1"),
        ({"confidence": 1.1}, "confidence=1.1: expected a number above 0 and at most 1"),
        ({"confidence": float("nan")}, "confidence=nan: expected a number above 0 and at most 1"),
        ({"severity": -0.1}, "severity=-0.1: expected a number of at least 0 and at most 1.5"),
        ({"severity": 9.0}, "severity=9.0: expected a number of at least 0 and at most 1.5"),
    ],
)
def test_conditions_refuse_values_out_of_range(settings: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError) as error:
        ScenarioConfig(**{"actor": "robot"} | settings)
    assert str(error.value) == message


def turn_deg(first: np.ndarray, second: np.ndarray) -> float:
    return math.degrees(np.linalg.norm(rotation_vector(first[:3, :3].T @ second[:3, :3])))


def trajectory(seed: int, severity: float = 1.0, moves: bool = True) -> np.ndarray:
    return camera_trajectory(
        ScenarioConfig("robot", move_camera=moves, severity=severity), 90, np.random.default_rng(seed)
    )


def test_camera_trajectory_rests_without_move_camera() -> None:
    for resting in (trajectory(0, moves=False), trajectory(0, severity=0.0)):
        assert len(resting) == 90
        np.testing.assert_allclose(resting, np.repeat(resting[:1], 90, axis=0), atol=1e-12)
    assert np.abs(trajectory(0, moves=False)[0] - trajectory(1, moves=False)[0]).max() > 1e-3  # its position varies


@pytest.mark.slow
def test_camera_trajectory_turns_by_20_to_40_degrees_and_shifts() -> None:
    for seed in range(200):
        moved = trajectory(seed)
        assert 20 < turn_deg(moved[0], moved[-1]) < 40
        assert np.linalg.norm(moved[0, :3, 3] - moved[-1, :3, 3]) > 0.1
        # It turns slowly and never back.
        turns = [turn_deg(moved[0], matrix) for matrix in moved]
        assert np.all(np.diff(turns) > -0.01)
        assert np.diff(turns).max() < 1.5
    assert turn_deg(*trajectory(0, 0.5)[[0, -1]]) == pytest.approx(turn_deg(*trajectory(0)[[0, -1]]) / 2, rel=0.1)


def test_pan_aside_turns_on_the_spot_and_back() -> None:
    resting = trajectory(0, moves=False)
    aside = pan_aside(resting, 1.0)
    np.testing.assert_allclose(aside[[0, -1]], resting[[0, -1]], atol=1e-12)
    np.testing.assert_array_equal(aside[:, :3, 3], resting[:, :3, 3])
    farthest = aside[max(range(90), key=lambda frame: turn_deg(resting[0], aside[frame]))]
    assert farthest[2, 0] == pytest.approx(0, abs=1e-9)  # the image's rows stay level
    # The point in the center of the image has left to the right.
    camera = PinholeCamera(641, 481, 660.0, resting[0])
    center = resting[0, :3, 3] + 0.7 * resting[0, :3, 2]
    ((column, _),), _ = project(camera, center[None])
    assert column == pytest.approx(320)
    ((column, _),), _ = project(PinholeCamera(641, 481, 660.0, farthest), center[None])
    assert column > 641
    np.testing.assert_allclose(pan_aside(resting, 0.0), resting, atol=1e-12)


def test_target_range_and_its_samples() -> None:
    assert target_range(ScenarioConfig("robot")) == USUAL_TARGET_RANGE
    assert target_range(ScenarioConfig("robot", random_target=True)) == RANDOM_TARGET_RANGE
    full, half = RANDOM_TARGET_RANGE, target_range(ScenarioConfig("robot", random_target=True, severity=0.5))
    assert (half.x, half.y, half.yaw_rad) == (full.x / 2, full.y / 2, full.yaw_rad / 2)
    assert full.x > 3 * USUAL_TARGET_RANGE.x
    generator = np.random.default_rng(0)
    placements = [PlacementRange(0.1, 0.2, 0.3).sample_around(PlanarPose(1.0, 2.0, 3.0), generator) for _ in range(300)]
    rows = np.array([(placement.x - 1, placement.y - 2, placement.yaw_rad - 3) for placement in placements])
    assert np.all(np.abs(rows) <= [0.1, 0.2, 0.3])
    np.testing.assert_allclose(np.abs(rows).max(axis=0), [0.1, 0.2, 0.3], rtol=0.05)
    np.testing.assert_allclose(rows.mean(axis=0), 0, atol=0.03)
