"""States over time: steps that nothing explains are unsure until they are confirmed."""

from dataclasses import replace

import numpy as np
import pytest

from geoskill.geometry.primitives import NodeType
from geoskill.kernels.p2p import PointToPoint
from geoskill.model.bilinear import Bilinear
from geoskill.model.kernel_model import KernelModel
from geoskill.model.scorer import Motif
from geoskill.skill.association import Association, Goal, Node
from geoskill.skill.innovation import InnovationGate
from geoskill.skill.member_status import MemberStatus, State
from geoskill.skill.status_over_time import StatusOverTime
from geoskill.tuning import InnovationConfig

POINT = NodeType.POINT
CONFIG = InnovationConfig(goal_frames=3, frames=5)
STD = (0.7, 0.7)


@pytest.fixture
def status() -> StatusOverTime:
    kernel = PointToPoint()
    member = KernelModel(kernel, {POINT: "sift"}, Bilinear(Motif.of(kernel, {POINT: 4}), hidden_dim=2))
    member.goal.set_tolerance(3.0)
    return StatusOverTime("p2p_sift", member, CONFIG)


def pair(x: float, y: float, rest: tuple[float, float] = (0.0, 0.0), goal: object = "follows") -> Association:
    """Return a pair with this error; its goal is where the error is zero, unless another is given."""
    x, y = float(x), float(y)
    nodes = (Node(POINT, (rest[0] + x, rest[1] + y)), Node(POINT, rest))
    left = (x, y) if goal == "follows" else goal
    known = Goal(((rest[0], rest[1]), None), left, STD, 3.0) if isinstance(left, tuple) else None
    return Association("p2p_sift", "p2p", "sift", 1, 0.9, 0.1, nodes, (x, y), error_std=STD, goal=known)


def run(status: StatusOverTime, *frames: Association | None) -> list[MemberStatus]:
    """Return the status of frames between which nothing moves but what the associations say, in steps of flow."""
    statuses, last = [], None
    for association in frames:
        tracked = None
        if last is not None and association is not None:
            same = last.nodes[1] == association.nodes[1] and abs(last.error[0] - association.error[0]) < 9
            tracked = association.nodes if same else last.nodes
        statuses.append(status.advance(tracked, [] if association is None else [association]))
        last = association
    return statuses


def states(statuses: list[MemberStatus]) -> list[str]:
    return [str(own.state) for own in statuses]


def test_motion_that_flow_sees_is_certain(status: StatusOverTime) -> None:
    approach = [pair(40.0 - 8.0 * number, 1.0) for number in range(6)]
    seen = run(status, *approach)
    assert states(seen) == ["approaching"] * 5 + ["at goal"]
    assert all(own.error_is_certain and own.goal_error_is_certain for own in seen)


def test_step_is_unsure_until_its_goal_error_is_confirmed(status: StatusOverTime) -> None:
    seen = run(status, pair(40, 0), *[pair(-100, 5, rest=(200.0, 80.0))] * 5)
    assert states(seen) == ["approaching"] + ["unsure"] * 3 + ["approaching"] * 2
    assert [own.error_is_certain for own in seen] == [True, False, False, False, True, True]
    assert [own.goal_error_is_certain for own in seen] == [True, False, False, False, True, True]


def test_step_without_goal_error_is_unsure_for_longer(status: StatusOverTime) -> None:
    seen = run(status, pair(40, 0), *[pair(-100, 5, rest=(200.0, 80.0), goal=None)] * 7)
    assert states(seen) == ["approaching"] + ["unsure"] * 5 + ["approaching"] * 2
    assert not any(own.goal_error_is_certain for own in seen[1:])


def test_step_of_the_error_alone_is_unsure_for_one_frame(status: StatusOverTime) -> None:
    """Another pair of the same two things has another error, but as far to go."""
    seen = run(status, pair(40, 0), *[pair(55, 20, rest=(9.0, 9.0), goal=(40.5, 0.0))] * 2)
    assert states(seen) == ["approaching", "unsure", "approaching"]
    assert [own.error_is_certain for own in seen] == [True, False, True]
    assert all(own.goal_error_is_certain for own in seen)


def test_another_pair_at_the_goal_is_at_the_goal(status: StatusOverTime) -> None:
    seen = run(status, pair(0.5, 0), *[pair(15, 20, rest=(9.0, 9.0), goal=(0.3, 0.2))] * 2)
    assert states(seen) == ["at goal"] * 3
    assert [own.error_is_certain for own in seen] == [True, False, True]
    assert all(own.goal_error_is_certain for own in seen)


def test_step_during_confirmation_starts_it_again(status: StatusOverTime) -> None:
    first, second = pair(-100, 5, rest=(200.0, 80.0)), pair(60, 60, rest=(20.0, 90.0))
    seen = run(status, pair(40, 0), first, second, second, second, second)
    assert states(seen) == ["approaching"] + ["unsure"] * 4 + ["approaching"]


def test_goal_error_that_steps_alone_is_masked(status: StatusOverTime) -> None:
    seen = run(status, pair(40, 0), *[pair(40, 0, goal=(5.0, 90.0))] * 4)
    assert states(seen) == ["approaching"] * 5
    assert [own.goal_error_is_certain for own in seen] == [True, False, False, False, True]


def test_goal_error_goes_on_where_it_was_unknown_for_a_frame(status: StatusOverTime) -> None:
    seen = run(status, pair(40, 0), pair(36, 0, goal=None), pair(32, 0))
    assert [own.goal_error_is_certain for own in seen] == [True, False, True]


def test_lost_and_found_elsewhere_is_unsure(status: StatusOverTime) -> None:
    seen = run(status, pair(40, 0), None, None, *[pair(-60, 0, rest=(90.0, 0.0))] * 4)
    assert states(seen) == ["approaching", "lost", "lost", "unsure", "unsure", "unsure", "approaching"]
    assert not seen[1].error_is_certain
    assert seen[1].rows == ("p2p_sift.x", "p2p_sift.y")


def test_lost_and_found_again_is_certain(status: StatusOverTime) -> None:
    assert states(run(status, pair(40, 0), None, pair(41, 1))) == ["approaching", "lost", "approaching"]


def test_at_goal_needs_a_certain_goal_error(status: StatusOverTime) -> None:
    seen = run(status, pair(40, 0), *[pair(40, 0, goal=(0.5, 0.5))] * 4)
    assert states(seen) == ["approaching"] * 4 + ["at goal"]


def test_gate_by_hand() -> None:
    gate, zero, std = InnovationGate(InnovationConfig(max_sigma=5.0)), np.zeros(2), np.array([0.6, 0.6])
    assert gate.goes_on(zero, std, (4.99, -4.99), (0.8, 0.8)), "5 sigma of 0.6 and 0.8 are 5"
    assert not gate.goes_on(zero, std, (0.0, 5.01), (0.8, 0.8))
    tolerant = InnovationGate(InnovationConfig(), tolerance=6.0)
    assert tolerant.goes_on(zero, std, (0.0, 5.9), (0.8, 0.8))
    assert gate.is_certain
    gate.take_in(False, 2)
    assert not gate.is_certain
    gate.take_in(True, 9)
    assert not gate.is_certain
    gate.take_in(True, 9)
    assert gate.is_certain
    gate.take_in(False, 9)
    gate.take_in(True, 1)
    assert gate.is_certain, "a confirmation may shorten what is left"


def test_status_says_what_the_listed_agree_on(status: StatusOverTime) -> None:
    first = pair(40, 0)
    second, third = (replace(pair(own, 0), rank=rank) for rank, own in ((2, 41.0), (3, -90.0)))
    seen = status.advance(None, [first, second, third])
    assert seen.agreement == pytest.approx(2 / 3)
    assert seen.offset_px == pytest.approx((40.5, 0.0), abs=0.1)
    assert seen.as_json() == {
        "state": "approaching",
        "switched": False,
        "error_available": [True, True],
        "goal_error_available": [True, True],
        "agreement": 0.6667,
        "offset_px": [pytest.approx(40.5, abs=0.1), pytest.approx(0.0, abs=0.1)],
    }
    assert status.advance(None, [first]).agreement is None
    assert State("at goal") is State.AT_GOAL


def test_switch_is_another_association_than_in_the_frame_before(status: StatusOverTime) -> None:
    """The first one, and one after a frame without any, are no switches."""
    own = pair(40, 0)
    given = [(own, False), (own, True), (own, False), (None, False), (own, False), (own, True)]
    seen = [status.advance(None, [] if top is None else [top], kept=kept).switched for top, kept in given]
    assert seen == [False, False, True, False, False, False]
