"""The neutral record of a frame."""

import json
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest

from geoskill import Skill
from geoskill.control.action import Dof, action_space
from geoskill.control.rows import Constraint
from geoskill.control.state import Decision, Mode, Record
from geoskill.exports.exporter import finite
from geoskill.exports.intrinsics import IntrinsicMotion
from geoskill.exports.record import NeutralRecord, frame_record, full_jacobian, point_pair, step_record


def test_record_of_a_frame_has_the_errors_of_the_associations(
    small_skill: Path, demonstration_frames: Sequence[np.ndarray], motion: IntrinsicMotion
) -> None:
    skill = Skill.load(small_skill)
    result = skill.infer(demonstration_frames[0])
    plain = frame_record(7, 0.25, skill, result)
    known = frame_record(7, 0.25, skill, result, motion)
    assert (plain["frame"], plain["time_s"], plain["state"], plain["twist"]) == (7, 0.25, "observe", None)
    assert (plain["dof"], plain["twist_frame"]) == ([], None)
    assert (known["dof"], known["twist_frame"]) == ([str(dof) for dof in Dof], "camera")
    assert len(plain["rows"]) == len(known["rows"]) > 1
    by_node = {
        (own.member, *(tuple(np.round(node.coordinates, 2)) for node in own.nodes)): own for own in result.associations
    }
    for row, full in zip(plain["rows"], known["rows"], strict=True):
        association = by_node[(row["member"], *map(tuple, row["nodes"]))]
        assert row["kernel"] == association.kernel
        np.testing.assert_allclose(row["error"], association.error, atol=1e-3)
        assert row["jacobian"] is None
        assert np.shape(full["jacobian"]) == (len(row["error"]), 6)
    assert json.loads(json.dumps(finite(known), allow_nan=False))


def test_jacobian_of_a_pair_is_the_field_at_the_carried_point(
    record_of: Callable[..., NeutralRecord], scene: Sequence[Constraint], motion: IntrinsicMotion
) -> None:
    first, exchanged = record_of(*scene)["rows"][:2]
    np.testing.assert_allclose(first["jacobian"], motion.jacobian(np.array([[101.5, 66.0]]))[0], atol=1e-3)
    np.testing.assert_allclose(exchanged["jacobian"], -motion.jacobian(np.array([[420.0, 310.0]]))[0], atol=1e-3)


def test_pair_is_where_the_carried_point_is_and_is_to_be(
    record_of: Callable[..., NeutralRecord], scene: Sequence[Constraint]
) -> None:
    first, exchanged, with_goal, _, line = record_of(*scene)["rows"]
    assert point_pair(first) == ([101.5, 66.0], pytest.approx([75.2, 140.9]))
    assert point_pair(exchanged) == ([420.0, 310.0], pytest.approx([400.0, 300.0]))
    assert point_pair(with_goal) == ([250.0, 90.0], pytest.approx([264.0, 97.0]))  # of an error (-10, -9) to (4, -2)
    assert point_pair(line) is None
    assert point_pair({**first, "carried": [True, True]}) is None


def test_record_of_a_step() -> None:
    space = action_space("descent")
    record = Record(4, Decision(Mode.SERVO, np.array([0.01, 0.0, -0.002, 0.05])), notes=("limited",))
    own = step_record(record, space, 10.0)
    assert own["twist_frame"] == "base"
    assert own["action"] == [0.01, 0.0, -0.002, 0.05]
    np.testing.assert_allclose(own["twist"], [0.1, 0, -0.02, 0, 0, 0.5])
    assert (own["state"], own["notes"], own["rows"]) == ("servo", ["limited"], [])


def test_components_that_are_not_commanded_have_zeros() -> None:
    record = {"dof": ["x", "y", "z", "yaw"]}
    row = {"jacobian": [[1.0, 2.0, 3.0, 4.0], [5.0, 6.0, 7.0, 8.0]]}
    assert full_jacobian(record, row) == [[1, 2, 3, 0, 0, 4], [5, 6, 7, 0, 0, 8]]
    assert full_jacobian(record, {"jacobian": None}) is None


def test_row_of_an_uncertain_member_is_not_to_be_used(
    small_skill: Path, demonstration_frames: Sequence[np.ndarray]
) -> None:
    skill = Skill.load(small_skill)
    result = skill.infer(demonstration_frames[0])
    weights = {row["weight"] for row in frame_record(0, 0.0, skill, result)["rows"]}
    assert weights == {1.0}
    doubtful = {name: type(status)(status.rows, status.unit) for name, status in result.members.items()}
    lost = type(result)(result.associations, result.features, result.reasons, doubtful)
    assert {row["weight"] for row in frame_record(0, 0.0, skill, lost)["rows"]} == {0.0}


def test_numbers_that_are_none_become_null() -> None:
    assert finite({"a": [1.0, float("nan")], "b": (float("inf"), "x", None, 2)}) == {
        "a": [1.0, None],
        "b": [None, "x", None, 2],
    }
