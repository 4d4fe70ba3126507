"""Actions: limits scale all axes together, the way is bounded."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from geoskill.control.action import DOF_SETS, ActionSpace, Dof, Limits, action_space, twist
from geoskill.control.exploration import probe_of, probing_moves
from geoskill.control.safety import safe_action, usable, way_back
from tests.control.small_loops import pair

SPACE = action_space("descent")
NUMBERS = st.floats(allow_nan=True, allow_infinity=True)


@given(st.lists(NUMBERS, min_size=4, max_size=4), st.lists(NUMBERS, min_size=4, max_size=4))
def test_safe_action_never_exceeds_a_limit(action: list[float], travelled: list[float]) -> None:
    safe = safe_action(SPACE, np.array(travelled), np.array(action))
    assert np.isfinite(safe).all()
    assert (np.abs(safe) <= SPACE.step * (1 + 1e-12)).all()
    start = np.array(travelled)
    if np.isfinite(start).all():
        bounds = SPACE.of(SPACE.limits.travel_m, SPACE.limits.travel_rad)
        assert (np.abs(start + safe) <= np.maximum(bounds, np.abs(start)) + 1e-12).all()


def test_limited_keeps_the_direction() -> None:
    action = np.array([0.024, -0.006, 0.0, math.radians(1.7)])
    np.testing.assert_allclose(SPACE.limited(action), action / 2)
    np.testing.assert_array_equal(SPACE.limited(action / 4), action / 4)


def test_floor_and_way_out_are_closed_and_the_way_back_open() -> None:
    space = ActionSpace(limits=Limits(down_m=0.1, travel_m=0.2))
    below = space.within_travel(np.array([0.25, 0.0, -0.1, 0.0]), np.array([0.01, 0.01, -0.01, 0.0]))
    np.testing.assert_allclose(below, [0.0, 0.01, 0.0, 0.0])
    np.testing.assert_allclose(
        space.within_travel(np.array([0.25, 0.0, -0.1, 0.0]), np.array([-0.01, 0.0, 0.01, 0.0])),
        [-0.01, 0.0, 0.01, 0.0],
    )


def test_probing_moves_end_where_they_began_within_the_limits() -> None:
    for dof in DOF_SETS:
        space = action_space(dof, Limits(step_m=0.004))
        moves = probing_moves(space)
        assert len(moves) == 2 * len(space.dofs)
        np.testing.assert_allclose(sum(moves), 0.0, atol=1e-15)
        assert all((np.abs(move) <= space.step).all() for move in moves)
    np.testing.assert_allclose(probe_of(action_space("xyzy")), [0.01, 0.01, 0.01, math.radians(3)])


def test_twist_of_a_set() -> None:
    space = action_space("xyzabc")
    assert space.dofs == tuple(Dof)
    np.testing.assert_allclose(twist(space, np.arange(6) / 100, 10.0), np.arange(6) / 10)


@pytest.mark.parametrize("field", ["step_m", "step_rad", "travel_m", "travel_rad", "down_m"])
@pytest.mark.parametrize("value", [0.0, -1.0, float("nan"), float("inf")])
def test_limits_are_positive_numbers(field: str, value: float) -> None:
    with pytest.raises(ValueError, match=f"{field}={value}: expected a positive number"):
        Limits(**{field: value})


def test_unknown_set_of_degrees_of_freedom() -> None:
    with pytest.raises(ValueError, match="dof=xyz: expected one of descent, xyzy, xyzabc"):
        action_space("xyz")


def test_way_back_is_reversed() -> None:
    way = [np.array([0.02, 0.0, 0.0, 0.0]), np.array([0.0, 0.02, 0.0, 0.1]), np.array([0.0, 0.0, 0.02, 0.0])]
    back = way_back(way, SPACE, 0.03)
    np.testing.assert_allclose(back, [[0, 0, -0.02, 0], [0, -0.02, 0, -0.1]])


@pytest.mark.parametrize(
    ("moving", "confidence", "expected"),
    [
        ((10.0, 10.0), 0.5, True),
        ((10.0, 10.0), 0.1, False),
        ((10.0, 10.0), float("nan"), False),
        ((float("nan"), 10.0), 0.5, False),
        ((1e9, 10.0), 0.5, False),
        ((-5.0, 10.0), 0.5, False),
        ((639.4, 479.4), 0.5, True),
    ],
)
def test_gate(moving: tuple[float, float], confidence: float, expected: bool) -> None:
    assert usable(pair(moving, (50.0, 60.0), confidence=confidence), (640, 480), 0.2) is expected
