"""Conditions: what is refused, and what the camera does under them."""

import math
from typing import Any

import numpy as np
import pytest

from geoskill.errors import InputError
from geoskill.geometry.camera import PinholeCamera, project
from geoskill.geometry.poses import rotation_vector
from geoskill.simulation.conditions import (
    RANDOM_TARGET_RANGE,
    USUAL_TARGET_RANGE,
    Conditions,
    camera_trajectory,
    pan_aside,
)
from geoskill.simulation.tasks.task import PlacementRange, PlanarPose


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"actor": "dog"}, "scenario.actor=dog: expected human or robot"),
        ({"confidence": 0.0}, "scenario.confidence=0.0: expected more than 0 and at most 1"),
        ({"confidence": 1.1}, "scenario.confidence=1.1: expected more than 0 and at most 1"),
        ({"confidence": float("nan")}, "scenario.confidence=nan: expected more than 0 and at most 1"),
        ({"severity": -0.1}, "scenario.severity=-0.1: expected 0 to 1.5"),
        ({"severity": 9.0}, "scenario.severity=9.0: expected 0 to 1.5"),
    ],
)
def test_what_cannot_be_is_refused(settings: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError) as error:
        Conditions(**{"actor": "robot"} | settings)
    assert str(error.value) == message


def turn_deg(first: np.ndarray, second: np.ndarray) -> float:
    return math.degrees(np.linalg.norm(rotation_vector(first[:3, :3].T @ second[:3, :3])))


def course(seed: int, severity: float = 1.0, moves: bool = True) -> np.ndarray:
    return camera_trajectory(Conditions("robot", move_camera=moves, severity=severity), 90, np.random.default_rng(seed))


def test_the_camera_is_at_rest_unless_it_is_to_move() -> None:
    for still in (course(0, moves=False), course(0, severity=0.0)):
        assert len(still) == 90
        np.testing.assert_allclose(still, np.repeat(still[:1], 90, axis=0), atol=1e-12)
    assert np.abs(course(0, moves=False)[0] - course(1, moves=False)[0]).max() > 1e-3  # nobody puts it twice alike


@pytest.mark.slow
def test_the_camera_turns_by_20_to_40_degrees_and_is_displaced() -> None:
    for seed in range(200):
        moved = course(seed)
        assert 20 < turn_deg(moved[0], moved[-1]) < 40
        assert np.linalg.norm(moved[0, :3, 3] - moved[-1, :3, 3]) > 0.1
        # It turns all the time, never by more than one would by hand, and never back.
        turns = [turn_deg(moved[0], matrix) for matrix in moved]
        assert np.all(np.diff(turns) > -0.01)
        assert np.diff(turns).max() < 1.5
    assert turn_deg(*course(0, 0.5)[[0, -1]]) == pytest.approx(turn_deg(*course(0)[[0, -1]]) / 2, rel=0.1)


def test_looking_aside_the_camera_pans_on_the_spot_and_comes_back() -> None:
    resting = course(0, moves=False)
    aside = pan_aside(resting, 1.0)
    np.testing.assert_allclose(aside[[0, -1]], resting[[0, -1]], atol=1e-12)
    np.testing.assert_array_equal(aside[:, :3, 3], resting[:, :3, 3])
    farthest = aside[max(range(90), key=lambda frame: turn_deg(resting[0], aside[frame]))]
    assert farthest[2, 0] == pytest.approx(0, abs=1e-9)  # the picture's rows stay level
    # What was in the middle has left to the right.
    lens = PinholeCamera(641, 481, 660.0, resting[0])
    middle = resting[0, :3, 3] + 0.7 * resting[0, :3, 2]
    ((column, _),), _ = project(lens, middle[None])
    assert column == pytest.approx(320)
    ((column, _),), _ = project(PinholeCamera(641, 481, 660.0, farthest), middle[None])
    assert column > 641
    np.testing.assert_allclose(pan_aside(resting, 0.0), resting, atol=1e-12)


def test_how_far_places_lie_apart() -> None:
    assert Conditions("robot").target_range() == USUAL_TARGET_RANGE
    assert Conditions("robot", random_target=True).target_range() == RANDOM_TARGET_RANGE
    wide, half = RANDOM_TARGET_RANGE, Conditions("robot", random_target=True, severity=0.5).target_range()
    assert (half.x, half.y, half.yaw_rad) == (wide.x / 2, wide.y / 2, wide.yaw_rad / 2)
    assert wide.x > 3 * USUAL_TARGET_RANGE.x
    generator = np.random.default_rng(0)
    places = [PlacementRange(0.1, 0.2, 0.3).around(PlanarPose(1.0, 2.0, 3.0), generator) for _ in range(300)]
    rows = np.array([(place.x - 1, place.y - 2, place.yaw_rad - 3) for place in places])
    assert np.all(np.abs(rows) <= [0.1, 0.2, 0.3])
    np.testing.assert_allclose(np.abs(rows).max(axis=0), [0.1, 0.2, 0.3], rtol=0.05)
    np.testing.assert_allclose(rows.mean(axis=0), 0, atol=0.03)
