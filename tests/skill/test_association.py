"""What stands in associations.jsonl, to the letter, and what a node is."""

import json

import pytest

from geoskill.geometry.primitives import NodeType
from geoskill.skill.association import Association, Node

POINT, LINE = NodeType.POINT, NodeType.LINE


def test_a_point_association_reads_as_agreed() -> None:
    association = Association(
        kernel="p2p",
        descriptor="sift",
        rank=1,
        confidence=0.93,
        nodes=(Node(POINT, (101.5, 66.0), 4), Node(POINT, (75.2, 140.9), 0)),
        error=(26.3, -74.9),
    )
    # The agreed line of associations.jsonl, without the frame, with the descriptor.
    assert json.dumps(association.as_json()) == (
        '{"kernel": "p2p", "descriptor": "sift", "rank": 1, "confidence": 0.93, '
        '"nodes": [{"type": "point", "xy": [101.5, 66.0]}, {"type": "point", "xy": [75.2, 140.9]}], '
        '"error": [26.3, -74.9]}'
    )


def test_lines_are_two_end_points() -> None:
    association = Association(
        "p2l", "sift+lbd", 2, 0.5, (Node(POINT, (1.0, 2.0)), Node(LINE, (1.0, 2.5, 30.0, 40.25), 7)), (-3.5,)
    )
    assert association.as_json()["nodes"] == [
        {"type": "point", "xy": [1.0, 2.0]},
        {"type": "line", "xy": [[1.0, 2.5], [30.0, 40.25]]},
    ]
    assert association.as_json()["error"] == [-3.5]
    assert association.member == ("p2l", "sift+lbd")


def test_numbers_are_rounded_to_what_can_be_meant() -> None:
    association = Association("p2p", "orb", 1, 1 / 3, (Node(POINT, (1 / 3, 2 / 3)),), (-1 / 3, 2 / 3))
    line = association.as_json()
    assert line["confidence"] == 0.333333
    assert line["nodes"] == [{"type": "point", "xy": [0.333, 0.667]}]
    assert line["error"] == [-0.3333, 0.6667]


def test_the_centre_of_a_point_and_of_a_segment() -> None:
    assert Node(POINT, (3.0, -4.5)).centre == (3.0, -4.5)
    assert Node(LINE, (1.0, 2.0, 4.0, 8.0)).centre == (2.5, 5.0)


@pytest.mark.parametrize(
    ("node_type", "coordinates", "message"),
    [
        (POINT, (1.0, 2.0, 3.0, 4.0), "a point has 4 coordinates; expected 2"),
        (POINT, (1.0,), "a point has 1 coordinates; expected 2"),
        (LINE, (1.0, 2.0), "a line has 2 coordinates; expected 4"),
    ],
)
def test_a_node_has_the_coordinates_of_its_type(
    node_type: NodeType, coordinates: tuple[float, ...], message: str
) -> None:
    with pytest.raises(ValueError, match=f"^{message}$"):
        Node(node_type, coordinates)
