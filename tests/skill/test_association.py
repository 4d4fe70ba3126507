"""Tests of associations and nodes, and of their exact form in associations.jsonl."""

import json
from dataclasses import replace

import numpy as np
import pytest

from geoskill.geometry.primitives import NodeType
from geoskill.skill.association import Association, Goal, InferenceResult, Node, NodeRole, abstain_below
from geoskill.skill.member_status import MemberStatus, State

POINT, LINE = NodeType.POINT, NodeType.LINE


def test_association_as_json_of_points() -> None:
    association = Association(
        member="p2p_sift",
        kernel="p2p",
        descriptor="sift",
        rank=1,
        confidence=0.93,
        weight=0.5,
        nodes=(Node(POINT, (101.5, 66.0), 4, NodeRole.MOVING), Node(POINT, (75.2, 140.9), 0, NodeRole.RESTING)),
        error=(26.3, -74.9),
        error_std=(0.70711, 0.70711),
        goal=Goal(((89.3, 69.1), None), (12.2, -3.1), (0.70711, 0.70711), tolerance=3.0),
    )
    # The documented line of associations.jsonl, without frame and time.
    assert json.dumps(association.as_json()) == (
        '{"kernel": "p2p", "descriptor": "sift", "rank": 1, "confidence": 0.93, "weight": 0.5, '
        '"nodes": [{"type": "point", "xy": [101.5, 66.0], "role": "moving"}, '
        '{"type": "point", "xy": [75.2, 140.9], "role": "resting"}], '
        '"error": [26.3, -74.9], "error_std": [0.7071, 0.7071], "unit": "px", '
        '"goal_error": [12.2, -3.1], "goal_error_std": [0.7071, 0.7071]}'
    )


def test_association_as_json_of_lines() -> None:
    association = Association(
        "p2l_sift_lbd",
        "p2l",
        "sift+lbd",
        2,
        0.5,
        0.25,
        (Node(POINT, (1.0, 2.0)), Node(LINE, (1.0, 2.5, 30.0, 40.25), 7)),
        (-3.5,),
    )
    assert association.as_json()["nodes"] == [
        {"type": "point", "xy": [1.0, 2.0]},
        {"type": "line", "xy": [[1.0, 2.5], [30.0, 40.25]]},
    ]
    assert association.as_json()["error"] == [-3.5]
    assert association.as_json()["goal_error"] is None


def test_association_as_json_rounds() -> None:
    association = Association("p2p_orb", "p2p", "orb", 1, 1 / 3, 2 / 3, (Node(POINT, (1 / 3, 2 / 3)),), (-1 / 3, 2 / 3))
    line = association.as_json()
    assert (line["confidence"], line["weight"]) == (0.333333, 0.666667)
    assert line["nodes"] == [{"type": "point", "xy": [0.333, 0.667]}]
    assert line["error"] == [-0.3333, 0.6667]


def test_node_center() -> None:
    assert Node(POINT, (3.0, -4.5)).center == (3.0, -4.5)
    assert Node(LINE, (1.0, 2.0, 4.0, 8.0)).center == (2.5, 5.0)


@pytest.mark.parametrize(
    ("node_type", "coordinates", "message"),
    [
        (POINT, (1.0, 2.0, 3.0, 4.0), "a point has 4 coordinates; expected 2"),
        (POINT, (1.0,), "a point has 1 coordinates; expected 2"),
        (LINE, (1.0, 2.0), "a line has 2 coordinates; expected 4"),
    ],
)
def test_node_requires_coordinates_of_its_type(
    node_type: NodeType, coordinates: tuple[float, ...], message: str
) -> None:
    with pytest.raises(ValueError, match=f"^{message}$"):
        Node(node_type, coordinates)


def test_abstain_below_drops_doubtful_members() -> None:
    nodes = (Node(POINT, (1.0, 2.0)), Node(POINT, (3.0, 4.0)))
    sure = Association("p2p_orb", "p2p", "orb", 1, 0.9, 0.5, nodes, (-2.0, -2.0))
    doubtful = Association("p2p_sift", "p2p", "sift", 1, 0.125, 0.5, nodes, (7.0, 8.0))
    # The second may be more confident, since the first was kept from the previous frame.
    second = Association("p2p_sift", "p2p", "sift", 2, 0.6, 0.25, nodes, (9.0, 9.0))
    reasons = {"l2l_lbd": "no instance: 1 lines found"}
    members = {
        name: MemberStatus((f"{name}.x", f"{name}.y"), "px", State.APPROACHING, True, True)
        for name in ("p2p_sift", "p2p_orb")
    }
    result = InferenceResult((doubtful, second, sure), {}, reasons, members)
    np.testing.assert_array_equal(result.error, [7.0, 8.0, -2.0, -2.0])
    left = abstain_below(result, 0.2)
    assert left.associations == (sure,)
    np.testing.assert_array_equal(left.error, [np.nan, np.nan, -2.0, -2.0])
    assert left.states == {"p2p_sift": State.LOST, "p2p_orb": State.APPROACHING}
    assert left.error_names == result.error_names == ("p2p_sift.x", "p2p_sift.y", "p2p_orb.x", "p2p_orb.y")
    assert left.reasons == {
        "l2l_lbd": "no instance: 1 lines found",
        "p2p_sift": "no association visible: the selected one has a confidence of 0.12, less than 0.2",
    }
    assert abstain_below(result, 0.125) is result, "the smallest confidence is still selected"
    for smallest in (0.0, 0.2, 1.0):
        unknown = InferenceResult((replace(sure, confidence=float("nan")),), {}, {})
        assert abstain_below(unknown, smallest).associations == (), "no number is not confident"
    nothing = abstain_below(result, 1.0)
    assert (nothing.associations, nothing.error.shape) == ((), (4,))
    assert not nothing.error_available.any()
