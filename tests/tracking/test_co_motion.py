"""What moves as one is known as such, against any background and however the camera moves."""

from collections.abc import Callable

import cv2
import numpy as np
import pytest

from geoskill.data.dead_leaves import dead_leaves
from geoskill.geometry.primitives import NodeType
from geoskill.kernels.l2l import LineToLine
from geoskill.kernels.p2l import PointToLine
from geoskill.kernels.p2p import PointToPoint
from geoskill.tracking.co_motion import LEAST_WAY, WINDOW, CoMotionDetector

HEIGHT, WIDTH, SIDE = 240, 320, 60
SPEED_PX = 2.0
# Relative to the upper left corner of the thing, and places of the table that it never comes near.
ON_THING = np.array([[20, 20], [42, 35]], np.float32)
ON_TABLE = np.array([[40, 40], [250, 210]], np.float32)

Place = Callable[[int], tuple[float, float]]


def gray(seed: int, height: int, width: int) -> np.ndarray:
    return np.asarray(cv2.cvtColor(dead_leaves(height, width, np.random.default_rng(seed)), cv2.COLOR_RGB2GRAY))


TABLE, THING, OTHER = gray(0, HEIGHT, WIDTH), gray(1, SIDE, SIDE), gray(2, SIDE, SIDE)


def to_the_right(frame: int) -> tuple[float, float]:
    return 60 + SPEED_PX * frame, 90


def frame_with(*things: tuple[np.ndarray, tuple[float, float]]) -> np.ndarray:
    picture = TABLE.copy()
    for thing, (x, y) in things:
        picture[round(y) : round(y) + SIDE, round(x) : round(x) + SIDE] = thing
    return picture


def watch(frames: int, *things: tuple[np.ndarray, Place]) -> CoMotionDetector:
    recent = CoMotionDetector()
    for frame in range(frames):
        recent.advance(frame_with(*((thing, place(frame)) for thing, place in things)))
    return recent


def pairs_as_one(recent: CoMotionDetector, points: np.ndarray, pairs: list[tuple[int, int]]) -> list[bool]:
    found = recent.co_moving(PointToPoint(), {NodeType.POINT: points.astype(np.float32)}, np.array(pairs).T)
    return [bool(each) for each in found]


def test_two_points_of_a_carried_thing_moved_as_one_and_those_of_the_table_did_not() -> None:
    last = 14
    points = np.concatenate([np.array(to_the_right(last)) + ON_THING, ON_TABLE])
    recent = watch(last + 1, (THING, to_the_right))
    pairs = [(0, 1), (0, 2), (1, 3), (2, 3)]
    assert pairs_as_one(recent, points, pairs) == [True, False, False, False]


def test_two_things_that_go_different_ways_are_not_one() -> None:
    def down(frame: int) -> tuple[float, float]:
        return 220, 10 + SPEED_PX * frame

    last = 14
    points = np.concatenate([np.array(to_the_right(last)) + ON_THING, np.array(down(last)) + ON_THING])
    recent = watch(last + 1, (THING, to_the_right), (OTHER, down))
    assert pairs_as_one(recent, points, [(0, 1), (2, 3), (0, 2), (1, 3)]) == [True, True, False, False]


@pytest.mark.parametrize("frames", [1, 2])
def test_at_first_nothing_has_moved(frames: int) -> None:
    # Two pixels are less than the least way of 4.8.
    assert SPEED_PX < LEAST_WAY * HEIGHT
    points = np.array(to_the_right(frames - 1)) + ON_THING
    assert pairs_as_one(watch(frames, (THING, to_the_right)), points, [(0, 1)]) == [False]


def test_what_has_come_to_rest_is_forgotten_after_the_window() -> None:
    def for_a_while(frame: int) -> tuple[float, float]:
        return to_the_right(min(frame, 12))

    points = np.array(to_the_right(12)) + ON_THING
    assert pairs_as_one(watch(13 + WINDOW - 6, (THING, for_a_while)), points, [(0, 1)]) == [True]
    assert pairs_as_one(watch(13 + WINDOW, (THING, for_a_while)), points, [(0, 1)]) == [False]


@pytest.mark.parametrize(("angle_deg", "shift_px", "scale"), [(0, 2.0, 1.0), (0.8, 0.0, 1.0), (0.4, 1.0, 1.005)])
def test_what_rests_before_a_moving_camera_rests(angle_deg: float, shift_px: float, scale: float) -> None:
    last, recent = 14, CoMotionDetector()
    matrix = np.eye(3)
    for frame in range(last + 1):
        matrix = np.concatenate([cv2.getRotationMatrix2D((WIDTH / 2, HEIGHT / 2), angle_deg * frame, scale**frame)])
        matrix[0, 2] += shift_px * frame
        seen = frame_with((THING, to_the_right(frame)))
        recent.advance(cv2.warpAffine(seen, matrix, (WIDTH, HEIGHT), borderMode=cv2.BORDER_REFLECT))
    points = np.concatenate([np.array(to_the_right(last)) + ON_THING, [[60, 80], [100, 60], [250, 160]]])
    points = points @ matrix[:, :2].T + matrix[:, 2]
    assert pairs_as_one(recent, points, [(0, 1), (2, 3), (2, 4), (0, 3)]) == [True, False, False, False]


def test_where_nothing_moves_as_most_of_the_picture_does_there_is_no_background() -> None:
    last, recent = 14, CoMotionDetector()
    strips = [gray(seed, HEIGHT // 3, 2 * WIDTH) for seed in (6, 7, 8)]
    for frame in range(last + 1):
        shifts = [round(speed * frame) for speed in (-2, 0, 2)]
        recent.advance(
            np.vstack(
                [strip[:, 100 + shift : 100 + shift + WIDTH] for strip, shift in zip(strips, shifts, strict=True)]
            )
        )
    points = np.array([[100.0, 30], [140, 50], [100, 110], [140, 130], [100, 190], [140, 210]])
    assert pairs_as_one(recent, points, [(0, 1), (2, 3), (4, 5)]) == [False, False, False]


def test_segments_are_followed_along_their_whole_length() -> None:
    last = 14
    recent = watch(last + 1, (THING, to_the_right))
    corner = np.array(to_the_right(last))
    points = np.concatenate([corner + ON_THING, ON_TABLE]).astype(np.float32)
    # Two of the thing, of which one is beside its edge, and one of the table.
    edge, across = ([*(corner + one), *(corner + other)] for one, other in (((3, 5), (3, 55)), ((10, 15), (45, 50))))
    lines = np.array([edge, across, [30, 30, 60, 50]], np.float32)
    geometry = {NodeType.POINT: points, NodeType.LINE: lines}
    as_one = recent.co_moving(PointToLine(), geometry, np.array([[0, 0, 2, 2], [1, 2, 1, 2]]))
    assert as_one.tolist() == [True, False, False, False]
    as_one = recent.co_moving(LineToLine(), {NodeType.LINE: lines}, np.array([[0, 0, 1], [1, 2, 2]]))
    assert as_one.tolist() == [True, False, False]


def test_what_has_just_come_into_sight_tells_nothing() -> None:
    last = 14

    def from_behind_the_table(frame: int) -> tuple[float, float]:
        return to_the_right(frame) if frame == last else (250, 170)

    points = np.array(to_the_right(last)) + ON_THING
    assert pairs_as_one(watch(last + 1, (THING, from_behind_the_table)), points, [(0, 1)]) == [False]


def test_a_frame_of_another_size_begins_anew() -> None:
    recent = watch(15, (THING, to_the_right))
    larger = np.pad(frame_with((THING, to_the_right(15))), ((0, 20), (0, 0)))
    recent.advance(larger)
    assert pairs_as_one(recent, np.array(to_the_right(15)) + ON_THING, [(0, 1)]) == [False]


def test_without_features_there_is_no_instance() -> None:
    recent = watch(3, (THING, to_the_right))
    found = recent.co_moving(
        PointToLine(),
        {NodeType.POINT: np.zeros((0, 2), np.float32), NodeType.LINE: np.zeros((0, 4), np.float32)},
        np.zeros((2, 0), np.int64),
    )
    assert found.shape == (0,)


def test_a_plain_picture_and_a_tiny_one_are_no_fault() -> None:
    for height, width in ((HEIGHT, WIDTH), (9, 7), (8, 3000)):
        recent = CoMotionDetector()
        for _ in range(3):
            recent.advance(np.full((height, width), 90, np.uint8))
        assert pairs_as_one(recent, np.array([[1.0, 1], [3, 4]]), [(0, 1)]) == [False]


def test_no_frame_has_no_motion() -> None:
    with pytest.raises(ValueError, match="no frame has been shown"):
        pairs_as_one(CoMotionDetector(), ON_TABLE, [(0, 1)])
