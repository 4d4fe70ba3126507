"""The robust step, Broyden's update, phases, stopping: numbers by hand and independent references."""

import numpy as np
import pytest

from geoskill.control.action import action_space
from geoskill.control.broyden import SlotJacobians, forgetting, updated
from geoskill.control.law import TRUST_PX, step_of
from geoskill.control.robust import Equations, robust_weights, solved
from geoskill.control.rows import Row
from geoskill.control.sequence import Phase, PhaseState, advanced, weights_of
from geoskill.control.settling import Settling
from geoskill.control.stopping import averaging, is_growing, is_settled, near_goal
from tests.control.small_loops import pair

SPACE = action_space("descent")
DRIVEN = [0, 1, 3]


def row(error: tuple[float, float], weight: float = 1.0, turn: float = 0.0) -> Row:
    """A p2p row: 1000 px per meter along x and y, `turn` px per radian."""
    jacobian = np.array([[1000.0, 0.0, 0.0, turn], [0.0, -1000.0, -500.0, -turn]])
    return Row(pair((300.0, 200.0), (310.0, 220.0)), np.array(error), jacobian, weight)


def test_damped_step_by_hand() -> None:
    """One component, J = 3, E = 6: a = -18 / (9 + 0.001 * 9)."""
    np.testing.assert_allclose(solved(np.array([[9.0]]), np.array([18.0])), [-18 / 9.009])
    assert solved(np.zeros((2, 2)), np.ones(2)).tolist() == [0.0, 0.0]
    assert solved(np.full((2, 2), np.nan), np.ones(2)).tolist() == [0.0, 0.0]


def test_step_removes_its_share_of_the_error() -> None:
    rows = [row((20.0, -10.0), turn=turn) for turn in (-40.0, -10.0, 15.0, 60.0)]
    step = step_of(rows, SPACE, DRIVEN, np.zeros(4), 0.5)
    np.testing.assert_allclose(step.action, [-0.010, -0.005, 0.0, 0.0], atol=3e-5)
    assert step.rms == pytest.approx(np.sqrt(500))
    assert step.rank == 3
    assert step.unit_std[2] == 0.0


def test_guided_component_is_compensated_in_full() -> None:
    """Down by 4 mm moves the picture by +2 px along y; y has to give 2 mm, whatever the gain."""
    rows = [row((0.0, 0.0), turn=turn) for turn in (-40.0, -10.0, 15.0, 60.0)]
    step = step_of(rows, SPACE, DRIVEN, np.array([0.0, 0.0, -0.004, 0.0]), 0.1)
    np.testing.assert_allclose(step.action, [0.0, 0.002, 0.0, 0.0], atol=1e-5)


def test_step_is_shortened_to_what_the_linear_model_is_trusted_for() -> None:
    rows = [row((400.0, 0.0), turn=turn) for turn in (-40.0, 0.0, 40.0, 80.0)]
    action = step_of(rows, SPACE, DRIVEN, np.zeros(4), 1.0).action
    assert max(np.linalg.norm(own.jacobian @ action) for own in rows) == pytest.approx(TRUST_PX, rel=1e-6)


def test_wrong_associations_get_no_weight_even_from_afar() -> None:
    rng = np.random.default_rng(0)
    true = np.array([0.15, -0.08, 0.0, 0.3])
    rows = []
    for index in range(8):
        own = row((0.0, 0.0), turn=rng.uniform(-80, 80))
        error = -own.jacobian @ true + rng.normal(0, 0.7, 2)
        rows.append(Row(own.constraint, error + (rng.normal(0, 60, 2) if index in (2, 5) else 0.0), own.jacobian))
    weights = robust_weights(Equations.of(rows, SPACE.step), DRIVEN)
    assert weights[[2, 5]].tolist() == [0.0, 0.0]
    assert (np.delete(weights, [2, 5]) > 0.5).all()


def test_few_associations_keep_their_weights() -> None:
    rows = [row((0.0, 0.0)), row((100.0, 0.0)), row((0.0, 50.0))]
    assert robust_weights(Equations.of(rows, SPACE.step), DRIVEN).tolist() == [1.0, 1.0, 1.0]


def test_broyden_satisfies_the_secant_equation_and_changes_least() -> None:
    rng = np.random.default_rng(1)
    old, action, change = rng.normal(size=(2, 4)), rng.normal(size=4), rng.normal(size=2)
    new = updated(old, change, action, 1.0)
    np.testing.assert_allclose(new @ action, change)
    other = new + np.outer([1.0, -1.0], np.linalg.svd(action[None])[2][1])  # explains the change as well
    np.testing.assert_allclose(other @ action, change)
    assert np.linalg.norm(new - old) < np.linalg.norm(other - old)
    np.testing.assert_array_equal(updated(old, change, np.zeros(4), 1.0), old)


def test_forgetting_is_weighted_least_squares() -> None:
    rng, memory = np.random.default_rng(2), 0.9
    actions, changes = rng.normal(size=(12, 3)), rng.normal(size=(12, 2))
    jacobian, covariance = np.zeros((2, 3)), 1e6 * np.eye(3)
    for action, change in zip(actions, changes, strict=True):
        jacobian, covariance = forgetting(jacobian, covariance, change, action, memory)
    weights = memory ** np.arange(11, -1, -1)
    normal = (actions * weights[:, None]).T @ actions + memory**12 * 1e-6 * np.eye(3)
    np.testing.assert_allclose(jacobian, np.linalg.solve(normal, (actions * weights[:, None]).T @ changes).T, rtol=1e-6)


def test_slots_learn_from_probing_moves() -> None:
    move = np.array([0.01, 0.0, 0.0, 0.0])
    slots = SlotJacobians().advanced([row((5.0, 0.0))], np.zeros(4), SPACE, False)
    slots = slots.advanced([row((15.0, 0.0))], move, SPACE, True)
    [applied] = slots.applied([row((15.0, 0.0))], SPACE)
    np.testing.assert_allclose(applied.jacobian, [[1000.0, 0, 0, 0], [0, 0, 0, 0]])


def test_phases_follow_each_other_and_come_back() -> None:
    phases = (Phase({"l2l": Settling(0.7, 6.0, 1.0)}, ()), Phase({"p2p": Settling(0.8, 4.0, 1.0)}, ("l2l",)))
    state = PhaseState()
    assert weights_of(phases, state) == {"l2l": 1.0, "p2p": 0.1}
    for _ in range(4):
        state = advanced(phases, state, {"l2l": 11.9, "p2p": 40.0})
    assert state.phase == 0
    state = advanced(phases, state, {})  # not seen: nothing is decided, and counting begins anew
    for _ in range(5):
        state = advanced(phases, state, {"l2l": 11.9, "p2p": 40.0})
    assert state.phase == 1
    assert weights_of(phases, state)["p2p"] == pytest.approx(0.1)
    for _ in range(10):
        state = advanced(phases, state, {"l2l": 20.0, "p2p": 40.0})
    assert weights_of(phases, state) == {"l2l": 1.0, "p2p": 1.0}
    for _ in range(5):
        state = advanced(phases, state, {"l2l": 25.0})
    assert state.phase == 0
    assert advanced((), PhaseState(), {"l2l": 1.0}) == PhaseState()


def test_stopping() -> None:
    assert is_settled([50.0, 1.0, 1.0, 1.0, 1.0])
    assert not is_settled([50.0, 1.0, 1.2, 1.2, 1.2])
    falling = [100 * 0.9**frame for frame in range(29)]
    assert not is_settled([*falling, 5.0])
    assert is_settled([*falling, *[40.0] * 30])
    assert not is_growing([10.0] * 30)
    assert not is_growing([1.0 + 0.5 * frame for frame in range(11)])  # of no size yet
    assert near_goal([row((3.0, 0.0)), row((40.0, 0.0))], [1.0] * 10)[0].error.tolist() == [3.0, 0.0]
    assert len(near_goal([row((3.0, 0.0)), row((40.0, 0.0))], [1.0] * 10)) == 1


def test_averaging_is_what_a_simulation_finds() -> None:
    rng, gain, frames = np.random.default_rng(3), 0.35, 30
    poses = np.sqrt(gain / (2 - gain)) * rng.normal(size=20000)
    for frame in range(frames):
        own = gain / (1 + frame / 6)
        poses = poses - own * (poses + rng.normal(size=20000))
    assert averaging(gain, frames) == pytest.approx(poses.var(), rel=0.05)
