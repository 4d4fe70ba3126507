"""Followed features that are the same, are others, or are lost."""

from functools import partial

import cv2
import numpy as np
import pytest

from geoskill.evaluation.switches import SwitchCount, SwitchCounter
from geoskill.geometry.primitives import NodeType
from geoskill.kernels.l2l import LineToLine
from geoskill.kernels.p2l import PointToLine
from geoskill.kernels.p2p import PointToPoint
from geoskill.skill.association import Association, Node, track_nodes
from geoskill.skill.matching import is_same_association, is_same_feature
from geoskill.tracking.flow import track_between


def texture(seed: int = 0) -> np.ndarray:
    """A smooth random picture of 160x120 px, which flow can follow everywhere."""
    noise = np.random.default_rng(seed).uniform(0, 255, (120, 160)).astype(np.float32)
    smooth = np.asarray(cv2.GaussianBlur(noise, (0, 0), 2.0))
    scaled = np.interp(smooth, (smooth.min(), smooth.max()), (0, 255)).astype(np.uint8)
    return np.repeat(scaled[:, :, None], 3, axis=2)


PICTURE = texture()


def shifted(dx: int, dy: int) -> np.ndarray:
    return np.roll(PICTURE, (dy, dx), axis=(0, 1))


def point(x: float, y: float) -> Node:
    return Node(NodeType.POINT, (float(x), float(y)))


def line(*coordinates: float) -> Node:
    return Node(NodeType.LINE, tuple(map(float, coordinates)))


def association(*nodes: Node) -> Association:
    return Association("p2p_sift", "p2p", "sift", 1, 0.5, 0.5, nodes, (0.0, 0.0))


@pytest.mark.parametrize(
    ("found", "same"), [((3.0, 0.0), True), ((3.1, 0.0), False), ((2.1, 2.1), True), ((2.2, 2.2), False)]
)
def test_points_are_the_same_within_three_pixels(found: tuple[float, float], same: bool) -> None:
    assert is_same_feature(point(0.0, 0.0), point(*found)) is same


@pytest.mark.parametrize(
    ("found", "same"),
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
def test_lines_are_the_same_when_near_and_parallel(found: tuple[float, ...], same: bool) -> None:
    horizontal = line(0, 0, 100, 0)
    assert is_same_feature(horizontal, line(*found)) is same
    assert is_same_feature(line(*found), horizontal) is same


def test_a_segment_without_length_has_a_place_but_every_direction() -> None:
    assert is_same_feature(line(5, 5, 5, 5), line(0, 4, 10, 4))
    assert not is_same_feature(line(5, 5, 5, 5), line(0, 0, 10, 0))
    assert is_same_feature(line(5, 5, 5, 5), line(6, 6, 6, 6))


def test_a_point_is_no_line() -> None:
    assert not is_same_feature(point(5, 5), line(0, 5, 10, 5))


def test_order_matters_only_where_the_motif_tells_nodes_apart() -> None:
    a, b, other = point(0, 0), point(50, 0), point(0, 50)
    assert is_same_association(PointToPoint(), (a, b), (a, b))
    assert is_same_association(PointToPoint(), (a, b), (b, a))
    assert not is_same_association(PointToPoint(), (a, b), (a, other))
    assert not is_same_association(PointToPoint(), (a, b), (a, a))
    first, second = line(0, 0, 50, 0), line(0, 40, 50, 40)
    assert is_same_association(LineToLine(), (first, second), (second, first))
    assert is_same_association(PointToLine(), (a, second), (a, second))
    assert not is_same_association(PointToLine(), (a, second), (b, second))
    assert not is_same_association(PointToLine(), (a, second), (a, first))


def test_nodes_of_both_types_move_with_the_picture_and_keep_their_places() -> None:
    nodes = (point(60, 50), line(40, 70, 100, 70), point(90, 40))
    moved = track_nodes(nodes, partial(track_between, start=PICTURE, end=shifted(4, 2)))
    assert moved is not None
    expected = [(64, 52), (44, 72, 104, 72), (94, 42)]
    assert [node.node_type for node in moved] == [node.node_type for node in nodes]
    for node, coordinates in zip(moved, expected, strict=True):
        np.testing.assert_allclose(node.coordinates, coordinates, atol=0.3)


def test_one_lost_node_loses_the_association() -> None:
    right = cv2.warpAffine(PICTURE, np.float32([[1, 0, 8], [0, 1, 0]]), (160, 120), borderMode=cv2.BORDER_REFLECT)
    follow = partial(track_between, start=PICTURE, end=right)
    assert track_nodes((point(40, 50), point(120, 50)), follow) is not None
    assert track_nodes((point(40, 50), point(156, 50)), follow) is None, "it has left the picture"


def test_keeping_the_moving_features_is_no_switch_and_taking_others_is_one() -> None:
    counter = SwitchCounter(PointToPoint())
    switched = []
    for frame, nodes in enumerate(
        [
            [point(60, 50), point(90, 60)],
            [point(94, 62), point(64, 52)],  # the same two, in the other order
            [point(68, 54), point(98, 64)],
            [point(72, 56), point(40, 64)],  # one is another
            [point(60, 50), point(90, 60)],  # the places of frame 0, where other features are now
        ]
    ):
        counter.advance(shifted(4 * frame, 2 * frame))
        switched.append(counter.evaluate(association(*nodes)))
    assert switched == [None, False, False, True, True]
    assert counter.count == SwitchCount(switches=2, comparable=4)


def test_transitions_with_a_lost_node_are_left_out() -> None:
    counter = SwitchCounter(PointToPoint())
    switched = []
    for image in (PICTURE, texture(seed=1), texture(seed=1)):
        counter.advance(image)
        switched.append(counter.evaluate(association(point(60, 50), point(90, 60))))
    assert switched == [None, None, False]
    assert counter.count == SwitchCount(switches=0, comparable=1)


def test_frames_without_association_break_the_chain() -> None:
    counter = SwitchCounter(PointToPoint())
    top = association(point(60, 50), point(90, 60))
    switched = []
    for listed in (top, None, top, top):
        counter.advance(PICTURE)
        switched.append(counter.evaluate(listed))
    assert switched == [None, None, None, False]


def test_nodes_are_followed_through_frames_that_are_not_judged() -> None:
    # 6 px a frame for 8 frames: the chain arrives where the single step of 48 px is lost.
    start, end = (point(50, 40), point(70, 70)), (point(98, 40), point(118, 70))
    assert track_nodes(start, partial(track_between, start=shifted(0, 0), end=shifted(48, 0))) is None
    counter = SwitchCounter(PointToPoint())
    counter.advance(shifted(0, 0))
    assert counter.evaluate(association(*start)) is None
    for frame in range(1, 9):
        counter.advance(shifted(6 * frame, 0))
    assert counter.evaluate(association(*end)) is False
