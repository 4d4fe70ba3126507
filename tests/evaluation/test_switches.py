"""Tests of tracking nodes and counting switches."""

from functools import partial

import cv2
import numpy as np

from geoskill.evaluation.switches import SwitchCount, SwitchCounter
from geoskill.geometry.primitives import NodeType
from geoskill.kernels.p2p import PointToPoint
from geoskill.skill.association import Association, Node, track_nodes
from geoskill.tracking.flow import track_between


def texture(seed: int = 0) -> np.ndarray:
    """Return a smooth random image of 160x120 px, in which flow can track every point."""
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


def test_track_nodes_of_both_types() -> None:
    nodes = (point(60, 50), line(40, 70, 100, 70), point(90, 40))
    moved = track_nodes(nodes, partial(track_between, start=PICTURE, end=shifted(4, 2)))
    assert moved is not None
    expected = [(64, 52), (44, 72, 104, 72), (94, 42)]
    assert [node.node_type for node in moved] == [node.node_type for node in nodes]
    for node, coordinates in zip(moved, expected, strict=True):
        np.testing.assert_allclose(node.coordinates, coordinates, atol=0.3)


def test_track_nodes_with_a_lost_node() -> None:
    right = cv2.warpAffine(PICTURE, np.float32([[1, 0, 8], [0, 1, 0]]), (160, 120), borderMode=cv2.BORDER_REFLECT)
    follow = partial(track_between, start=PICTURE, end=right)
    assert track_nodes((point(40, 50), point(120, 50)), follow) is not None
    assert track_nodes((point(40, 50), point(156, 50)), follow) is None, "it has left the image"


def test_switch_counter_on_moving_features() -> None:
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


def test_switch_counter_skips_transitions_with_a_lost_node() -> None:
    counter = SwitchCounter(PointToPoint())
    switched = []
    for image in (PICTURE, texture(seed=1), texture(seed=1)):
        counter.advance(image)
        switched.append(counter.evaluate(association(point(60, 50), point(90, 60))))
    assert switched == [None, None, False]
    assert counter.count == SwitchCount(switches=0, comparable=1)


def test_switch_counter_on_frames_without_association() -> None:
    counter = SwitchCounter(PointToPoint())
    top = association(point(60, 50), point(90, 60))
    switched = []
    for listed in (top, None, top, top):
        counter.advance(PICTURE)
        switched.append(counter.evaluate(listed))
    assert switched == [None, None, None, False]


def test_switch_counter_tracks_through_frames_in_between() -> None:
    # 6 px a frame for 8 frames: the chain arrives where the single step of 48 px is lost.
    start, end = (point(50, 40), point(70, 70)), (point(98, 40), point(118, 70))
    assert track_nodes(start, partial(track_between, start=shifted(0, 0), end=shifted(48, 0))) is None
    counter = SwitchCounter(PointToPoint())
    counter.advance(shifted(0, 0))
    assert counter.evaluate(association(*start)) is None
    for frame in range(1, 9):
        counter.advance(shifted(6 * frame, 0))
    assert counter.evaluate(association(*end)) is False
