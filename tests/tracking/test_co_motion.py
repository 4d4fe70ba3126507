"""Detection of co-motion on objects that move over a table, seen by a resting or moving camera."""

from collections.abc import Callable

import cv2
import numpy as np
import pytest

from geoskill.data.dead_leaves import dead_leaves
from geoskill.geometry.primitives import NodeType
from geoskill.kernels.l2l import LineToLine
from geoskill.kernels.p2l import PointToLine
from geoskill.kernels.p2p import PointToPoint
from geoskill.tracking.co_motion import CoMotionDetector
from geoskill.tuning import CoMotionConfig

HEIGHT, WIDTH, SIDE = 240, 320, 60
SPEED_PX = 2.0
# Relative to the upper left corner of the object, and on the table, far from the object's path.
ON_OBJECT = np.array([[20, 20], [42, 35]], np.float32)
ON_TABLE = np.array([[40, 40], [250, 210]], np.float32)

Path = Callable[[int], tuple[float, float]]


def gray(seed: int, height: int, width: int) -> np.ndarray:
    return np.asarray(cv2.cvtColor(dead_leaves(height, width, np.random.default_rng(seed)), cv2.COLOR_RGB2GRAY))


TABLE, OBJECT, OTHER = gray(0, HEIGHT, WIDTH), gray(1, SIDE, SIDE), gray(2, SIDE, SIDE)


def to_the_right(frame: int) -> tuple[float, float]:
    return 60 + SPEED_PX * frame, 90


def frame_with(*objects: tuple[np.ndarray, tuple[float, float]]) -> np.ndarray:
    picture = TABLE.copy()
    for object_picture, (x, y) in objects:
        picture[round(y) : round(y) + SIDE, round(x) : round(x) + SIDE] = object_picture
    return picture


def watch(frames: int, *objects: tuple[np.ndarray, Path], config: CoMotionConfig | None = None) -> CoMotionDetector:
    detector = CoMotionDetector(config)
    for frame in range(frames):
        detector.advance(frame_with(*((picture, path(frame)) for picture, path in objects)))
    return detector


def co_moving_pairs(detector: CoMotionDetector, points: np.ndarray, pairs: list[tuple[int, int]]) -> list[bool]:
    co_moving = detector.co_moving(PointToPoint(), {NodeType.POINT: points.astype(np.float32)}, np.array(pairs).T)
    return [bool(pair) for pair in co_moving]


def test_co_moving_points_of_a_carried_object_and_not_of_the_table() -> None:
    last = 14
    points = np.concatenate([np.array(to_the_right(last)) + ON_OBJECT, ON_TABLE])
    detector = watch(last + 1, (OBJECT, to_the_right))
    pairs = [(0, 1), (0, 2), (1, 3), (2, 3)]
    assert co_moving_pairs(detector, points, pairs) == [True, False, False, False]


def test_co_moving_excludes_objects_that_move_differently() -> None:
    def down(frame: int) -> tuple[float, float]:
        return 220, 10 + SPEED_PX * frame

    last = 14
    points = np.concatenate([np.array(to_the_right(last)) + ON_OBJECT, np.array(down(last)) + ON_OBJECT])
    detector = watch(last + 1, (OBJECT, to_the_right), (OTHER, down))
    assert co_moving_pairs(detector, points, [(0, 1), (2, 3), (0, 2), (1, 3)]) == [True, True, False, False]


@pytest.mark.parametrize("frames", [1, 2])
def test_co_moving_is_empty_in_the_first_frames(frames: int) -> None:
    # Two pixels are less than the smallest displacement of 4.8.
    assert CoMotionConfig().min_displacement_ratio * HEIGHT > SPEED_PX
    points = np.array(to_the_right(frames - 1)) + ON_OBJECT
    assert co_moving_pairs(watch(frames, (OBJECT, to_the_right)), points, [(0, 1)]) == [False]


def test_co_moving_forgets_resting_features_after_the_window() -> None:
    window = CoMotionConfig().window_frames

    def for_a_while(frame: int) -> tuple[float, float]:
        return to_the_right(min(frame, 12))

    points = np.array(to_the_right(12)) + ON_OBJECT
    assert co_moving_pairs(watch(13 + window - 6, (OBJECT, for_a_while)), points, [(0, 1)]) == [True]
    assert co_moving_pairs(watch(13 + window, (OBJECT, for_a_while)), points, [(0, 1)]) == [False]


@pytest.mark.parametrize(("angle_deg", "shift_px", "scale"), [(0, 2.0, 1.0), (0.8, 0.0, 1.0), (0.4, 1.0, 1.005)])
def test_co_moving_excludes_resting_features_seen_by_a_moving_camera(
    angle_deg: float, shift_px: float, scale: float
) -> None:
    last, detector = 14, CoMotionDetector()
    matrix = np.eye(3)
    for frame in range(last + 1):
        matrix = np.concatenate([cv2.getRotationMatrix2D((WIDTH / 2, HEIGHT / 2), angle_deg * frame, scale**frame)])
        matrix[0, 2] += shift_px * frame
        still = frame_with((OBJECT, to_the_right(frame)))
        detector.advance(cv2.warpAffine(still, matrix, (WIDTH, HEIGHT), borderMode=cv2.BORDER_REFLECT))
    points = np.concatenate([np.array(to_the_right(last)) + ON_OBJECT, [[60, 80], [100, 60], [250, 160]]])
    points = points @ matrix[:, :2].T + matrix[:, 2]
    assert co_moving_pairs(detector, points, [(0, 1), (2, 3), (2, 4), (0, 3)]) == [True, False, False, False]


def test_co_moving_is_empty_without_a_background() -> None:
    last, detector = 14, CoMotionDetector()
    strips = [gray(seed, HEIGHT // 3, 2 * WIDTH) for seed in (6, 7, 8)]
    for frame in range(last + 1):
        shifts = [round(speed * frame) for speed in (-2, 0, 2)]
        detector.advance(
            np.vstack(
                [strip[:, 100 + shift : 100 + shift + WIDTH] for strip, shift in zip(strips, shifts, strict=True)]
            )
        )
    points = np.array([[100.0, 30], [140, 50], [100, 110], [140, 130], [100, 190], [140, 210]])
    assert co_moving_pairs(detector, points, [(0, 1), (2, 3), (4, 5)]) == [False, False, False]


def test_co_moving_compares_segments() -> None:
    last = 14
    detector = watch(last + 1, (OBJECT, to_the_right))
    corner = np.array(to_the_right(last))
    points = np.concatenate([corner + ON_OBJECT, ON_TABLE]).astype(np.float32)
    # Two on the object, one of which is close to its edge, and one on the table.
    edge, across = ([*(corner + start), *(corner + end)] for start, end in (((3, 5), (3, 55)), ((10, 15), (45, 50))))
    lines = np.array([edge, across, [30, 30, 60, 50]], np.float32)
    geometry = {NodeType.POINT: points, NodeType.LINE: lines}
    co_moving = detector.co_moving(PointToLine(), geometry, np.array([[0, 0, 2, 2], [1, 2, 1, 2]]))
    assert co_moving.tolist() == [True, False, False, False]
    co_moving = detector.co_moving(LineToLine(), {NodeType.LINE: lines}, np.array([[0, 0, 1], [1, 2, 2]]))
    assert co_moving.tolist() == [True, False, False]


def test_co_moving_excludes_features_that_have_just_appeared() -> None:
    last = 14

    def appearing_in_the_last_frame(frame: int) -> tuple[float, float]:
        return to_the_right(frame) if frame == last else (250, 170)

    points = np.array(to_the_right(last)) + ON_OBJECT
    assert co_moving_pairs(watch(last + 1, (OBJECT, appearing_in_the_last_frame)), points, [(0, 1)]) == [False]


def test_advance_restarts_at_a_frame_of_another_size() -> None:
    detector = watch(15, (OBJECT, to_the_right))
    larger = np.pad(frame_with((OBJECT, to_the_right(15))), ((0, 20), (0, 0)))
    detector.advance(larger)
    assert co_moving_pairs(detector, np.array(to_the_right(15)) + ON_OBJECT, [(0, 1)]) == [False]


def test_co_moving_without_features() -> None:
    detector = watch(3, (OBJECT, to_the_right))
    co_moving = detector.co_moving(
        PointToLine(),
        {NodeType.POINT: np.zeros((0, 2), np.float32), NodeType.LINE: np.zeros((0, 4), np.float32)},
        np.zeros((2, 0), np.int64),
    )
    assert co_moving.shape == (0,)


def test_co_moving_in_uniform_and_tiny_pictures() -> None:
    for height, width in ((HEIGHT, WIDTH), (9, 7), (8, 3000)):
        detector = CoMotionDetector()
        for _ in range(3):
            detector.advance(np.full((height, width), 90, np.uint8))
        assert co_moving_pairs(detector, np.array([[1.0, 1], [3, 4]]), [(0, 1)]) == [False]


@pytest.mark.parametrize(
    ("config", "co_moving"),
    [
        (CoMotionConfig(), True),
        (CoMotionConfig(window_frames=2), False),  # in which it moves by 4 pixels, less than 4.8
        (CoMotionConfig(window_frames=2, min_displacement_ratio=0.01), True),
        (CoMotionConfig(min_displacement_ratio=0.2), False),
        (CoMotionConfig(min_background_ratio=1.0), False),
        (CoMotionConfig(working_side=480), True),
    ],
)
def test_co_moving_depends_on_config(config: CoMotionConfig, co_moving: bool) -> None:
    points = np.array(to_the_right(14)) + ON_OBJECT
    detector = watch(15, (OBJECT, to_the_right), config=config)
    assert co_moving_pairs(detector, points, [(0, 1)]) == [co_moving]


@pytest.mark.parametrize(("max_difference_ratio", "co_moving"), [(0.3, False), (0.6, True)])
def test_co_moving_compares_displacements_up_to_max_difference(max_difference_ratio: float, co_moving: bool) -> None:
    def at_half_the_speed(frame: int) -> tuple[float, float]:
        return 60 + SPEED_PX / 2 * frame, 20

    points = np.stack([np.array(to_the_right(14)) + ON_OBJECT[0], np.array(at_half_the_speed(14)) + ON_OBJECT[0]])
    config = CoMotionConfig(max_difference_ratio=max_difference_ratio)
    detector = watch(15, (OBJECT, to_the_right), (OTHER, at_half_the_speed), config=config)
    assert co_moving_pairs(detector, points, [(0, 1)]) == [co_moving]


@pytest.mark.parametrize("side", [16, 480])
def test_co_moving_at_the_limits_of_the_working_side(side: int) -> None:
    for height, width in ((HEIGHT, WIDTH), (9, 7), (8, 3000)):
        detector = CoMotionDetector(CoMotionConfig(working_side=side))
        for _ in range(2):
            detector.advance(np.full((height, width), 90, np.uint8))
        assert co_moving_pairs(detector, np.array([[1.0, 1], [3, 4]]), [(0, 1)]) == [False]


def test_co_moving_before_the_first_frame_is_refused() -> None:
    with pytest.raises(ValueError, match="no frame has been shown"):
        co_moving_pairs(CoMotionDetector(), ON_TABLE, [(0, 1)])
