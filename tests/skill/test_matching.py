"""Tests of matching features and associations."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from geoskill.geometry.primitives import NodeType
from geoskill.kernels.l2l import LineToLine
from geoskill.kernels.p2l import PointToLine
from geoskill.kernels.p2p import PointToPoint
from geoskill.skill.association import Node
from geoskill.skill.matching import find_feature, is_same_association, is_same_feature


def point(x: float, y: float) -> Node:
    return Node(NodeType.POINT, (float(x), float(y)))


def line(*coordinates: float) -> Node:
    return Node(NodeType.LINE, tuple(map(float, coordinates)))


@pytest.mark.parametrize(
    ("coordinates", "same"), [((3.0, 0.0), True), ((3.1, 0.0), False), ((2.1, 2.1), True), ((2.2, 2.2), False)]
)
def test_is_same_feature_of_points(coordinates: tuple[float, float], same: bool) -> None:
    assert is_same_feature(point(0.0, 0.0), point(*coordinates)) is same


@pytest.mark.parametrize(
    ("coordinates", "same"),
    [
        ((0, 0, 100, 0), True),
        ((100, 0, 0, 0), True),  # end points have no order
        ((0, 3, 100, 3), True),
        ((0, 3.1, 100, 3.1), False),
        ((70, 1, 98, 1), True),  # a piece of it
        ((-900, 0, 1000, 0), True),  # it is a piece of this
        ((110, 0, 200, 0), False),  # farther along on the same straight line
        ((50, -50, 50, 50), False),  # crosses it at the midpoint
        ((0, -8, 100, 8), True),  # atan(0.16) = 9.1 degrees
        ((0, -9, 100, 9), False),  # atan(0.18) = 10.2 degrees
        ((0, 9, 100, -9), False),
    ],
)
def test_is_same_feature_of_lines(coordinates: tuple[float, ...], same: bool) -> None:
    horizontal = line(0, 0, 100, 0)
    assert is_same_feature(horizontal, line(*coordinates)) is same
    assert is_same_feature(line(*coordinates), horizontal) is same


def test_is_same_feature_of_segment_without_length() -> None:
    assert is_same_feature(line(5, 5, 5, 5), line(0, 4, 10, 4))
    assert not is_same_feature(line(5, 5, 5, 5), line(0, 0, 10, 0))
    assert is_same_feature(line(5, 5, 5, 5), line(6, 6, 6, 6))


def test_is_same_feature_of_point_and_line() -> None:
    assert not is_same_feature(point(5, 5), line(0, 5, 10, 5))


def test_is_same_association_in_any_equivalent_order() -> None:
    a, b, c = point(0, 0), point(50, 0), point(0, 50)
    assert is_same_association(PointToPoint(), (a, b), (a, b))
    assert is_same_association(PointToPoint(), (a, b), (b, a))
    assert not is_same_association(PointToPoint(), (a, b), (a, c))
    assert not is_same_association(PointToPoint(), (a, b), (a, a))
    first, second = line(0, 0, 50, 0), line(0, 40, 50, 40)
    assert is_same_association(LineToLine(), (first, second), (second, first))
    assert is_same_association(PointToLine(), (a, second), (a, second))
    assert not is_same_association(PointToLine(), (a, second), (b, second))
    assert not is_same_association(PointToLine(), (a, second), (a, first))


@given(st.sampled_from(NodeType), st.integers(0, 12), st.booleans(), st.integers(0, 2**32 - 1))
def test_find_feature_is_nearest_of_all_same_features(
    node_type: NodeType, count: int, whole_pixels: bool, seed: int
) -> None:
    rows = np.random.default_rng(seed).uniform(0, 9, (count + 1, node_type.geometry_dim)).astype(np.float32)
    rows = np.floor(rows) if whole_pixels else rows  # some at equal distances
    node, geometry = Node(node_type, tuple(rows[0].tolist())), rows[1:]
    detected = [Node(node.node_type, tuple(row)) for row in geometry.tolist()]
    distances = [math.dist(node.center, other.center) for other in detected]
    same = [feature for feature, other in enumerate(detected) if is_same_feature(node, other)]
    found = find_feature(node, geometry)
    if found is None:
        assert not same
    else:
        assert found in same
        assert distances[found] == pytest.approx(min(distances[feature] for feature in same), rel=1e-12, abs=1e-12)


def test_find_feature_takes_the_first_of_equally_near_ones() -> None:
    assert find_feature(point(5, 5), np.array([[9, 9], [6, 5], [4, 5], [5, 6]], np.float32)) == 1
    assert find_feature(point(5, 5), np.zeros((0, 2), np.float32)) is None
    # The nearest midpoint belongs to a line in another direction.
    assert find_feature(line(0, 0, 10, 0), np.array([[5, -5, 5, 5], [2, 0, 12, 0]], np.float32)) == 1


@pytest.mark.parametrize(
    ("node_type", "shift", "same"),
    [(NodeType.PLANE, 8, True), (NodeType.PLANE, 20, False), (NodeType.CONIC, 4, True), (NodeType.CONIC, 8, False)],
)
def test_outlines_and_ellipses_are_the_same_within_a_share_of_their_size(
    node_type: NodeType, shift: float, same: bool
) -> None:
    first = (60.0, 40.0, 100.0, 40.0, 100.0, 80.0, 60.0, 80.0)
    if node_type is NodeType.CONIC:
        first = (100.0, 60.0, 60.0, 60.0, 80.0, 75.0, 80.0, 45.0)
    moved = tuple(value + shift * (place % 2 == 0) for place, value in enumerate(first))
    assert is_same_feature(Node(node_type, first), Node(node_type, moved)) is same
    larger = tuple(
        80 + 3 * (value - 80) if place % 2 == 0 else 60 + 3 * (value - 60) for place, value in enumerate(first)
    )
    assert not is_same_feature(Node(node_type, first), Node(node_type, larger))
