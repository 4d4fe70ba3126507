"""Trajectories of features on a patch that moves over a background by a known amount."""

import cv2
import numpy as np
import pytest

from geoskill.features.feature_set import FeatureSet
from geoskill.geometry.primitives import NodeType
from geoskill.tracking.motion import Trajectory
from geoskill.tracking.neighbor_flows import neighbor_flows
from geoskill.tracking.trajectories import trajectories
from geoskill.tuning import TrajectoryConfig

POINT, LINE = NodeType.POINT, NodeType.LINE
ANCHORS = TrajectoryConfig().anchors
FRAMES, STEP = 31, np.array([2.0, 0.0], np.float32)
HEIGHT, WIDTH = 120, 220
# Positions in frame 0 on the patch, which moves by STEP per frame until frame REST, and on the resting background.
ON_PATCH = np.array([[40, 55], [48, 65], [55, 52]], np.float32)
ON_GROUND = np.array([[30, 25], [120, 60], [180, 100]], np.float32)
REST = 25
PATCH = (slice(45, 75), slice(32, 62))


def texture(seed: int, height: int, width: int) -> np.ndarray:
    random = np.random.default_rng(seed)
    total = np.zeros((height, width, 3))
    for sigma in (1.5, 4):
        layer = cv2.GaussianBlur(random.normal(size=total.shape), (0, 0), sigma)
        total += layer / layer.std()
    return np.clip(128 + 30 * total, 0, 255).astype(np.uint8)


def moved(t: int) -> np.ndarray:
    return min(t, REST) * STEP


@pytest.fixture(scope="module")
def frames() -> list[np.ndarray]:
    ground, patch = texture(0, HEIGHT, WIDTH), texture(1, 30, 30)
    pictures = []
    for t in range(FRAMES):
        picture = ground.copy()
        x = PATCH[1].start + int(moved(t)[0])
        picture[PATCH[0], x : x + 30] = patch
        pictures.append(picture)
    return pictures


def feature_set(geometry: np.ndarray, descriptors: np.ndarray, node_type: NodeType = POINT) -> FeatureSet:
    return FeatureSet(node_type, descriptors, geometry.astype(np.float32), np.zeros(len(geometry), np.float32))


def detections(t: int, patch: bool = True) -> FeatureSet:
    """Return all features of a frame, each with its own descriptor."""
    geometry = np.concatenate([ON_GROUND, ON_PATCH + moved(t)]) if patch else ON_GROUND
    return feature_set(geometry, np.eye(6, dtype=np.float32)[: len(geometry)])


def trajectories_of(
    features: list[FeatureSet], frames: list[np.ndarray], hop: int = 2, config: TrajectoryConfig | None = None
) -> list[Trajectory]:
    flows = neighbor_flows(frames, hop, lambda items, text: items)
    return trajectories(features, flows, hop, HEIGHT, config)


def anchor_frames() -> np.ndarray:
    return np.linspace(0, FRAMES - 1, ANCHORS).round().astype(int)


@pytest.mark.parametrize("hop", [1, 2, 3])
def test_trajectories_of_features_detected_in_every_frame_are_fully_known(frames: list[np.ndarray], hop: int) -> None:
    result = trajectories_of([detections(t) for t in range(FRAMES)], frames, hop)
    for t, trajectory in enumerate(result):
        assert trajectory.anchor_xy.shape == (6, ANCHORS, 2)
        assert trajectory.first_known_anchor.tolist() == [0] * 6
        for anchor, a in enumerate(anchor_frames()):
            frame = t - (t - a) // hop * hop if a <= t else t  # the last whole hop before the anchor
            np.testing.assert_allclose(trajectory.anchor_xy[3:, anchor], ON_PATCH + moved(frame), atol=1.5)
            np.testing.assert_allclose(trajectory.anchor_xy[:3, anchor], ON_GROUND, atol=1.5)


def test_anchors_are_known_from_the_first_detection(frames: list[np.ndarray]) -> None:
    """The patch is detected from frame 10 on; earlier positions by flow do not count."""
    result = trajectories_of([detections(t, patch=t >= 10) for t in range(FRAMES)], frames)
    first = int(np.searchsorted(anchor_frames(), 10))
    for t in (20, 30):
        assert result[t].first_known_anchor.tolist() == [0, 0, 0, first, first, first]
    # For frame 11, only its own position is known.
    assert int(result[11].first_known_anchor[3]) in {first, ANCHORS}


def test_anchors_across_a_gap_in_the_detections_are_known_by_flow(frames: list[np.ndarray]) -> None:
    result = trajectories_of([detections(t, patch=not 8 <= t < 16) for t in range(FRAMES)], frames)
    assert result[24].first_known_anchor.tolist() == [0] * 6
    np.testing.assert_allclose(result[24].anchor_xy[3:, 0], ON_PATCH, atol=1.5)


def test_anchors_are_unknown_where_descriptors_differ(frames: list[np.ndarray]) -> None:
    """Features at the final position before the patch arrives are not its own, although flow may lead there."""
    features = []
    for t in range(FRAMES):
        geometry = np.concatenate([ON_GROUND, ON_PATCH + moved(REST)])
        descriptors = np.eye(9, dtype=np.float32)[[0, 1, 2, 3, 4, 5] if t >= REST else [0, 1, 2, 6, 7, 8]]
        features.append(feature_set(geometry, descriptors))
    result = trajectories_of(features, frames)
    first = int(np.searchsorted(anchor_frames(), REST))
    assert result[FRAMES - 1].first_known_anchor.tolist() == [0, 0, 0, first, first, first]


@pytest.mark.parametrize("anchors", [1, 4])
def test_trajectories_have_as_many_anchors_as_configured(frames: list[np.ndarray], anchors: int) -> None:
    features = [detections(t) for t in range(FRAMES)]
    few = trajectories_of(features, frames, config=TrajectoryConfig(anchors=anchors))[FRAMES - 1]
    usual = trajectories_of(features, frames)[FRAMES - 1]
    assert few.anchor_xy.shape == (6, anchors, 2)
    every = (ANCHORS - 1) // max(anchors - 1, 1)
    np.testing.assert_array_equal(few.anchor_xy, usual.anchor_xy[:, ::every][:, :anchors])


@pytest.mark.parametrize(("max_gap_hops", "is_known"), [(4, False), (5, True)])
def test_anchors_are_unknown_across_a_gap_longer_than_configured(
    frames: list[np.ndarray], max_gap_hops: int, is_known: bool
) -> None:
    """The patch is undetected in frames 8 to 15; frame 16 is five hops after frame 6."""
    features = [detections(t, patch=not 8 <= t < 16) for t in range(FRAMES)]
    result = trajectories_of(features, frames, config=TrajectoryConfig(max_gap_hops=max_gap_hops))[16]
    assert (result.first_known_anchor[3:] == 0).tolist() == [is_known] * 3


@pytest.mark.parametrize(("position_tolerance_ratio", "is_known"), [(0.01, False), (0.04, True)])
def test_anchors_are_known_within_the_configured_tolerance(
    frames: list[np.ndarray], position_tolerance_ratio: float, is_known: bool
) -> None:
    """Until frame 14 a resting feature is detected 3 pixels lower; the tolerances are of 1.2 and 4.8 pixels."""
    features = [detections(t) for t in range(FRAMES)]
    for t in range(15):
        features[t].geometry[1, 1] += 3
    config = TrajectoryConfig(position_tolerance_ratio=position_tolerance_ratio)
    first = int(trajectories_of(features, frames, config=config)[FRAMES - 1].first_known_anchor[1])
    assert (first == 0) is is_known


def test_final_positions_are_where_the_motion_ends(frames: list[np.ndarray]) -> None:
    result = trajectories_of([detections(t) for t in range(FRAMES)], frames)
    for t in (0, 7, 20, FRAMES - 1):
        assert result[t].final_known[3:].all()
        np.testing.assert_allclose(result[t].final_xy[3:], ON_PATCH + moved(FRAMES - 1), atol=2.5)  # over 15 hops
        assert result[t].final_known[0], "nothing passes over it"
        np.testing.assert_allclose(result[t].final_xy[0], ON_GROUND[0], atol=0.5)


@pytest.mark.parametrize(("rest_px", "known"), [(2.0, [True] * 3 + [False] * 3), (500.0, [True] * 6)])
def test_final_positions_of_covered_features_are_known_if_they_moved_less_than_rest_px(
    frames: list[np.ndarray], rest_px: float, known: list[bool]
) -> None:
    covered = [frame.copy() for frame in frames]
    for frame in covered[20:]:
        frame[:, :130] = 90
    config = TrajectoryConfig(rest_px=rest_px)
    result = trajectories_of([detections(t) for t in range(FRAMES)], covered, config=config)[4]
    assert result.final_known.tolist() == known


def test_final_positions_of_covered_features_are_known_if_they_rested(frames: list[np.ndarray]) -> None:
    """From frame 20 on a gray sheet covers the left half, with the moving features and two resting ones."""
    covered = [frame.copy() for frame in frames]
    for frame in covered[20:]:
        frame[:, :130] = 90
    result = trajectories_of([detections(t) for t in range(FRAMES)], covered)[4]
    assert result.final_known[:2].all()
    np.testing.assert_allclose(result.final_xy[:2], ON_GROUND[:2], atol=0.5)
    assert not result.final_known[3:].any()
    np.testing.assert_array_equal(
        result.final_xy[3:], detections(4).geometry[3:], "unknown, so the frame's own geometry"
    )


def test_trajectories_of_segments_with_varying_ends(frames: list[np.ndarray]) -> None:
    def segments(t: int) -> FeatureSet:
        start, end = np.array([38, 52]) + moved(t), np.array([56, 66]) + moved(t)
        cut = 0.15 * (t % 3)  # of the length, from one end
        return feature_set(
            np.array([[*(start + cut * (end - start)), *end], [20, 20, 60, 24]]), np.eye(2, 4, dtype=np.float32), LINE
        )

    result = trajectories_of([segments(t) for t in range(FRAMES)], frames)[24]
    assert result.anchor_xy.shape == (2, ANCHORS, 4)
    assert result.first_known_anchor.tolist() == [0, 0]
    midpoint = result.anchor_xy[0, 0].reshape(2, 2).mean(dim=0)
    np.testing.assert_allclose(midpoint, [47, 59], atol=3)


@pytest.mark.parametrize("hop", [1, 2])
def test_trajectories_of_frames_without_features(frames: list[np.ndarray], hop: int) -> None:
    features = [FeatureSet.empty(POINT, 6) if t % 3 else detections(t) for t in range(FRAMES)]
    result = trajectories_of(features, frames, hop)
    assert [len(trajectory.first_known_anchor) for trajectory in result] == [len(detected) for detected in features]
    empty = trajectories_of([FeatureSet.empty(LINE, 72)] * FRAMES, frames, hop)
    assert all(trajectory.anchor_xy.shape == (0, ANCHORS, 4) for trajectory in empty)


@pytest.mark.parametrize(
    ("similarity_ratio", "difference", "is_known"),
    [(0.5, 0.6, True), (0.5, 0.8, False), (0.4, 0.6, False), (0.6, 0.8, True)],
)
def test_similar_descriptors_differ_by_less_than_a_ratio_of_the_median_difference(
    frames: list[np.ndarray], similarity_ratio: float, difference: float, is_known: bool
) -> None:
    """Different features are 1.41 apart; from frame 14 on, one of them differs from its past by ``difference``."""
    features = []
    cosine = 1 - difference**2 / 2
    for t in range(FRAMES):
        descriptors = np.eye(6, dtype=np.float32)[:4].copy()
        if t >= 14:
            descriptors[3] = [0, 0, 0, cosine, np.sqrt(1 - cosine**2), 0]
        features.append(feature_set(np.concatenate([ON_GROUND, ON_PATCH[:1] + moved(t)]), descriptors))
    first = 0 if is_known else int(np.searchsorted(anchor_frames(), 14))
    result = trajectories_of(features, frames, config=TrajectoryConfig(similarity_ratio=similarity_ratio))[FRAMES - 1]
    assert result.first_known_anchor.tolist() == [0, 0, 0, first]
