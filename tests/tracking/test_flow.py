"""Tracking of points and segments of a textured picture through a known motion, and detection of lost ones."""

from collections.abc import Callable
from itertools import pairwise

import cv2
import numpy as np
import pytest

from geoskill.geometry.primitives import NodeType
from geoskill.tracking.flow import (
    SAMPLES_PER_SEGMENT,
    Flow,
    dense_flow,
    gray_flow,
    lucas_kanade,
    track_between,
    track_dense,
    track_sparse,
)

POINT, LINE = NodeType.POINT, NodeType.LINE
HEIGHT, WIDTH = 200, 260
CENTER = (130.0, 100.0)
SUBPIXEL = 0.5


@pytest.fixture(scope="module")
def texture() -> np.ndarray:
    """Return a picture with structure of every size, as coarse-to-fine tracking needs it."""
    random = np.random.default_rng(0)
    total = np.zeros((HEIGHT, WIDTH, 3))
    for sigma in (1.5, 4, 12):
        layer = cv2.GaussianBlur(random.normal(size=total.shape), (0, 0), sigma)
        total += layer / layer.std()
    return np.clip(128 + 25 * total, 0, 255).astype(np.uint8)


Track = Callable[[NodeType, np.ndarray, np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]


def track_sparse_in_color(
    node_type: NodeType, geometry: np.ndarray, start: np.ndarray, end: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    start, end = (np.asarray(cv2.cvtColor(frame, cv2.COLOR_RGB2GRAY)) for frame in (start, end))
    return track_sparse(node_type, geometry, start, end)


@pytest.fixture(params=[track_between, track_sparse_in_color], ids=["dense", "sparse"])
def track(request: pytest.FixtureRequest) -> Track:
    """Return the tracking functions by dense and by sparse flow."""
    chosen: Track = request.param
    return chosen


@pytest.fixture
def points() -> np.ndarray:
    return np.random.default_rng(1).uniform([50, 50], [210, 150], (40, 2)).astype(np.float32)


def motion(angle_deg: float = 0.0, scale: float = 1.0, shift: tuple[float, float] = (0.0, 0.0)) -> np.ndarray:
    matrix = cv2.getRotationMatrix2D(CENTER, angle_deg, scale)
    matrix[:, 2] += shift
    return matrix


def moved_picture(picture: np.ndarray, matrix: np.ndarray) -> np.ndarray:
    return np.asarray(
        cv2.warpAffine(picture, matrix, (WIDTH, HEIGHT), flags=cv2.INTER_CUBIC, borderMode=cv2.BORDER_REFLECT_101)
    )


def moved_points(points: np.ndarray, matrix: np.ndarray) -> np.ndarray:
    return points.reshape(-1, 2) @ matrix[:, :2].T + matrix[:, 2]


MOTIONS = [
    motion(),
    motion(shift=(5.3, -3.7)),
    motion(shift=(-14.0, 9.25)),
    motion(angle_deg=4.0),
    motion(angle_deg=-3.0, shift=(2.5, 1.5)),
]


@pytest.mark.parametrize("matrix", MOTIONS)
def test_track_points_is_accurate_to_a_fraction_of_a_pixel(
    track: Track, texture: np.ndarray, points: np.ndarray, matrix: np.ndarray
) -> None:
    geometry, tracked = track(POINT, points, texture, moved_picture(texture, matrix))
    assert tracked.all()
    assert geometry.dtype == np.float32
    np.testing.assert_allclose(geometry, moved_points(points, matrix), rtol=0, atol=SUBPIXEL)


@pytest.mark.parametrize("matrix", MOTIONS)
def test_track_segments_is_accurate_to_a_fraction_of_a_pixel(
    track: Track, texture: np.ndarray, points: np.ndarray, matrix: np.ndarray
) -> None:
    segments = points.reshape(-1, 4)
    geometry, tracked = track(LINE, segments, texture, moved_picture(texture, matrix))
    assert tracked.all()
    assert geometry.dtype == np.float32
    assert geometry.shape == segments.shape
    expected = moved_points(segments, matrix).reshape(-1, 4)
    # A segment must not come back with its end points exchanged.
    np.testing.assert_allclose(geometry, expected, rtol=0, atol=SUBPIXEL)


def test_track_segments_keeps_their_length_in_an_enlarged_picture(track: Track, texture: np.ndarray) -> None:
    segments = np.array([[90, 80, 170, 120], [130, 60, 130, 140]], np.float32)  # both centered at CENTER
    matrix = motion(scale=1.05, shift=(3.0, -2.0))
    geometry, tracked = track(LINE, segments, texture, moved_picture(texture, matrix))
    assert tracked.all()
    # 5 % of about 90 px would be 4.5 px; the best rigid motion is the shift of the center.
    np.testing.assert_allclose(lengths(geometry), lengths(segments), rtol=1e-5)
    np.testing.assert_allclose(geometry, segments + np.array([3, -2, 3, -2]), rtol=0, atol=SUBPIXEL)


def lengths(segments: np.ndarray) -> np.ndarray:
    return np.asarray(np.hypot(segments[:, 2] - segments[:, 0], segments[:, 3] - segments[:, 1]))


def test_track_loses_points_that_leave_the_picture(track: Track, texture: np.ndarray) -> None:
    points = np.array([[5, 60], [8, 140], [120, 60], [120, 140]], np.float32)
    end = moved_picture(texture, motion(shift=(-15.0, 0.0)))
    geometry, tracked = track(POINT, points, texture, end)
    assert tracked.tolist() == [False, False, True, True]
    np.testing.assert_allclose(geometry, [[5, 60], [8, 140], [105, 60], [105, 140]], rtol=0, atol=0.1)
    assert np.array_equal(geometry[:2], points[:2])


def test_track_loses_points_without_texture(track: Track, texture: np.ndarray) -> None:
    points = np.array([[60, 60], [60, 140], [200, 60], [200, 140]], np.float32)
    end = moved_picture(texture, motion(shift=(4.0, 0.0)))
    end[:, 160:] = 90
    geometry, tracked = track(POINT, points, texture, end)
    assert tracked.tolist() == [True, True, False, False]
    np.testing.assert_allclose(geometry, [[64, 60], [64, 140], [200, 60], [200, 140]], rtol=0, atol=0.1)
    assert np.array_equal(geometry[2:], points[2:])


def test_track_loses_covered_points(texture: np.ndarray) -> None:
    """A tile of another pattern, 50 px wide, moves 12 px to the right over the picture."""
    tile = np.ascontiguousarray(texture[::-1, ::-1])[60:110, 90:140]
    pictures = []
    for left in (80, 92):
        picture = texture.copy()
        picture[75:125, left : left + 50] = tile
        pictures.append(picture)
    points = np.array([[105, 100], [135, 100], [200, 100], [105, 30]], np.float32)
    geometry, tracked = track_between(POINT, points, *pictures)
    assert tracked.tolist() == [True, False, True, True]
    np.testing.assert_allclose(geometry, [[117, 100], [135, 100], [200, 100], [105, 30]], rtol=0, atol=SUBPIXEL)


def test_tolerance_bounds_the_distance_of_the_return(texture: np.ndarray, points: np.ndarray) -> None:
    end = moved_picture(texture, motion(angle_deg=6.0))
    kept = [
        track_between(POINT, points, texture, end, tolerance_px=tolerance)[1]
        for tolerance in (0.0, 0.01, 0.03, 0.1, 0.3, 1.0)
    ]
    assert not kept[0].any()
    assert kept[-1].all()
    assert all((strict <= loose).all() for strict, loose in pairwise(kept))
    assert any(0 < mask.sum() < len(points) for mask in kept)


def constant_flow(x: float, y: float, scale: float) -> Flow:
    field = np.zeros((40, 60, 2), np.float32) + np.array([x, y], np.float32)
    return Flow(field, -field, scale)


def test_track_dense_loses_points_beyond_the_border() -> None:
    # Pixel centers are whole numbers, so the picture ends half a pixel outside the last ones.
    points = np.array([[5, 20], [6.6, 20], [7.4, 20], [30, 1.4], [30, 0.6]], np.float32)
    geometry, tracked = track_dense(POINT, points, constant_flow(-7, 0, 1.0))
    assert tracked.tolist() == [False, True, True, True, True]
    assert np.array_equal(geometry[0], points[0])
    np.testing.assert_allclose(geometry[1:], points[1:] - [7, 0], rtol=0, atol=1e-4)
    _, tracked = track_dense(POINT, points, constant_flow(0, -1, 1.0))
    assert tracked.tolist() == [True, True, True, True, True]
    _, tracked = track_dense(POINT, points, constant_flow(0, -1.2, 1.0))
    assert tracked.tolist() == [True, True, True, True, False]
    _, tracked = track_dense(POINT, points, constant_flow(0, 19.6, 1.0))
    assert tracked.tolist() == [False, False, False, True, True]


def test_track_dense_scales_flow_and_tolerance_to_pixels_of_the_frame() -> None:
    geometry, tracked = track_dense(POINT, np.array([[50, 40]], np.float32), constant_flow(3, -2, 0.5))
    assert tracked.all()
    np.testing.assert_allclose(geometry, [[56, 36]], rtol=0, atol=1e-4)
    flow = constant_flow(3, -2, 0.5)
    # The return is 0.4 pixels of the reduced picture from the start, 0.8 pixels of the frame.
    beside = Flow(flow.forward, np.array([0.4, 0], np.float32) - flow.forward, 0.5)
    for tolerance, expected in ((0.75, False), (0.85, True)):
        _, tracked = track_dense(POINT, np.array([[50, 40]], np.float32), beside, tolerance_px=tolerance)
        assert tracked.tolist() == [expected]


def test_reversed_flow_tracks_backward(texture: np.ndarray, points: np.ndarray) -> None:
    end = moved_picture(texture, motion(angle_deg=3.0, shift=(4.0, 1.0)))
    flow = dense_flow(texture, end)
    for node_type in (POINT, LINE):
        given = points.reshape(-1, node_type.geometry_dim)
        for directed_flow, pair in ((flow, (texture, end)), (flow.reversed(), (end, texture))):
            expected, expected_mask = track_between(node_type, given, *pair)
            geometry, tracked = track_dense(node_type, given, directed_flow)
            assert np.array_equal(geometry, expected)
            assert np.array_equal(tracked, expected_mask)


def test_flow_without_backward_one_loses_only_what_leaves_the_frame(texture: np.ndarray) -> None:
    end = moved_picture(texture, motion(angle_deg=0.0, shift=(40.0, 0.0)))
    start_gray, end_gray = (np.asarray(cv2.cvtColor(picture, cv2.COLOR_RGB2GRAY)) for picture in (texture, end))
    checked, unchecked = (gray_flow(start_gray, end_gray, with_backward=check) for check in (True, False))
    assert np.array_equal(unchecked.forward, checked.forward)
    grid = np.stack(np.meshgrid(np.arange(2, WIDTH, 8), np.arange(2, HEIGHT, 8)), axis=-1)
    points = grid.reshape(-1, 2).astype(np.float32)
    moved, tracked = track_dense(POINT, points, unchecked)
    expected, consistent = track_dense(POINT, points, checked)
    assert consistent.sum() < tracked.sum() < len(points)
    assert np.array_equal(moved[consistent], expected[consistent])
    with pytest.raises(ValueError, match="no backward"):
        unchecked.reversed()


@pytest.mark.parametrize("factor", [3.0, 0.12])
def test_track_between_pictures_of_any_size(texture: np.ndarray, factor: float) -> None:
    """600 x 780 pixels, which are reduced for the flow, and 24 x 31, which are padded."""
    size = (round(WIDTH * factor), round(HEIGHT * factor))
    end = moved_picture(texture, motion(shift=(8.0, -4.0)))
    start, end = (np.asarray(cv2.resize(f, size, interpolation=cv2.INTER_AREA)) for f in (texture, end))
    points = np.array([[100, 80], [130, 100], [160, 120]], np.float32) * factor
    geometry, tracked = track_between(POINT, points, start, end)
    assert tracked.all()
    np.testing.assert_allclose(geometry, points + factor * np.array([8, -4]), rtol=0, atol=SUBPIXEL)


def test_segment_is_tracked_when_most_of_its_samples_are(texture: np.ndarray) -> None:
    segment = np.array([[40, 100, 220, 100]], np.float32)
    samples = np.stack([np.linspace(40, 220, SAMPLES_PER_SEGMENT), np.full(SAMPLES_PER_SEGMENT, 100)], axis=1)
    counts = set()
    for first_flat_column in range(60, 260, 10):
        end = moved_picture(texture, motion(shift=(3.0, 2.0)))
        end[:, first_flat_column:] = 90
        tracked_samples = int(track_between(POINT, samples.astype(np.float32), texture, end)[1].sum())
        geometry, tracked = track_between(LINE, segment, texture, end)
        counts.add(tracked_samples)
        assert tracked.tolist() == [tracked_samples >= 4]
        # The remaining samples determine the motion of the whole segment.
        expected = segment + np.array([3, 2, 3, 2]) if tracked_samples >= 4 else segment
        np.testing.assert_allclose(geometry, expected, rtol=0, atol=SUBPIXEL if tracked_samples >= 4 else 0)
    assert {3, 4, 7} <= counts


def test_segments_are_lost_independently(track: Track, texture: np.ndarray) -> None:
    segments = np.array([[40, 60, 100, 140], [200, 60, 230, 140], [40, 140, 100, 60]], np.float32)
    end = moved_picture(texture, motion(shift=(3.0, 0.0)))
    end[:, 160:] = 90
    geometry, tracked = track(LINE, segments, texture, end)
    assert tracked.tolist() == [True, False, True]
    np.testing.assert_allclose(geometry - segments, [[3, 0, 3, 0], [0, 0, 0, 0], [3, 0, 3, 0]], rtol=0, atol=SUBPIXEL)


@pytest.mark.parametrize("node_type", [POINT, LINE])
def test_track_no_features(track: Track, texture: np.ndarray, node_type: NodeType) -> None:
    geometry, tracked = track(node_type, np.zeros((0, node_type.geometry_dim), np.float32), texture, texture)
    assert geometry.shape == (0, node_type.geometry_dim)
    assert geometry.dtype == np.float32
    assert tracked.shape == (0,)
    assert tracked.dtype == bool


@pytest.mark.parametrize("node_type", [POINT, LINE])
def test_track_does_not_change_its_input(
    track: Track, texture: np.ndarray, points: np.ndarray, node_type: NodeType
) -> None:
    given = points.reshape(-1, node_type.geometry_dim)
    before = given.copy()
    geometry, _ = track(node_type, given, texture, moved_picture(texture, MOTIONS[1]))
    geometry += 1
    assert np.array_equal(given, before)


def test_track_sparse_loses_all_features_of_tiny_pictures() -> None:
    picture = np.random.default_rng(0).integers(0, 255, (20, 300), np.uint8)
    points = np.array([[10, 10], [200, 5]], np.float32)
    geometry, tracked = track_sparse(POINT, points, picture, picture)
    assert not tracked.any()
    assert np.array_equal(geometry, points)


def test_lucas_kanade_moves_points_and_checks_the_return(texture: np.ndarray, points: np.ndarray) -> None:
    start, end = (
        np.asarray(cv2.cvtColor(frame, cv2.COLOR_RGB2GRAY))
        for frame in (texture, moved_picture(texture, motion(shift=(5.3, -3.7))))
    )
    moved, consistent = lucas_kanade(points, start, end)
    assert consistent.all()
    np.testing.assert_allclose(moved, points + np.array([5.3, -3.7]), rtol=0, atol=SUBPIXEL)
    assert not lucas_kanade(points, start, end, tolerance_px=-1.0)[1].any()
    np.testing.assert_array_equal(track_sparse(POINT, points, start, end)[0], moved)


@pytest.mark.parametrize("node_type", [NodeType.PLANE, NodeType.CONIC])
def test_outlines_and_ellipses_move_with_what_they_show(node_type: NodeType) -> None:
    random = np.random.default_rng(0)
    picture = cv2.GaussianBlur(random.integers(0, 256, (120, 160, 3), np.uint8), (0, 0), 2.0)
    picture = cv2.normalize(picture, None, 0, 255, cv2.NORM_MINMAX)
    turn = cv2.getRotationMatrix2D((80.0, 60.0), 4.0, 1.0) + np.array([[0, 0, 3.0], [0, 0, -2.0]])
    moved_picture = cv2.warpAffine(picture, turn, (160, 120), borderMode=cv2.BORDER_REFLECT)
    geometry = np.array([[60, 40, 100, 40, 100, 80, 60, 80]], np.float32)
    if node_type is NodeType.CONIC:
        geometry = np.array([[100, 60, 60, 60, 80, 75, 80, 45]], np.float32)
    moved, tracked = track_between(node_type, geometry, picture, moved_picture)
    expected = geometry.reshape(-1, 2) @ turn[:, :2].T + turn[:, 2]
    assert tracked.all()
    np.testing.assert_allclose(moved.reshape(-1, 2), expected, atol=0.5)
