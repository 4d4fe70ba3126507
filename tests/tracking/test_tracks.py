"""Tracking over several spans at once, on a pattern that moves by a known amount."""

import cv2
import numpy as np
import pytest

from geoskill.features.feature_set import FeatureSet
from geoskill.geometry.primitives import NodeType
from geoskill.tracking.flow import track_between
from geoskill.tracking.motion import Displacement
from geoskill.tracking.neighbor_flows import neighbor_flows
from geoskill.tracking.tracks import chain_displacements, tracks_to_end

POINT, LINE = NodeType.POINT, NodeType.LINE
STEP = np.array([1.5, -1.0])
FRAMES = 9
# On the pattern in the first frame.
POINTS = np.array([[50, 60], [70, 50], [90, 80]])
SEGMENTS = np.array([[45, 60, 85, 80], [60, 75, 90, 45]])


@pytest.fixture(scope="module")
def frames() -> list[np.ndarray]:
    """Return frames of a pattern with structure of every size that moves by ``STEP`` per frame."""
    random = np.random.default_rng(0)
    total = np.zeros((120, 150, 3))
    for sigma in (1.5, 4, 12):
        layer = cv2.GaussianBlur(random.normal(size=total.shape), (0, 0), sigma)
        total += layer / layer.std()
    picture = np.clip(128 + 25 * total, 0, 255).astype(np.uint8)
    return [
        np.asarray(
            cv2.warpAffine(
                picture,
                np.array([[1, 0, STEP[0] * t], [0, 1, STEP[1] * t]]),
                (150, 120),
                flags=cv2.INTER_CUBIC,
                borderMode=cv2.BORDER_REFLECT_101,
            )
        )
        for t in range(FRAMES)
    ]


def feature_set(node_type: NodeType, geometry: np.ndarray) -> FeatureSet:
    count = len(geometry)
    return FeatureSet(
        node_type, np.eye(max(count, 1), 4, dtype=np.float32)[:count], geometry, np.zeros(count, np.float32)
    )


def features_at(t: int, node_type: NodeType = POINT) -> FeatureSet:
    """Return the same features in every frame, except for a single one in frame 3 and none in frame 5."""
    moved = shifted(POINTS if node_type is POINT else SEGMENTS, t)
    return feature_set(node_type, moved[: {3: 1, 5: 0}.get(t, len(moved))])


def shifted(geometry: np.ndarray, frames: int) -> np.ndarray:
    """Move points or segments with the pattern."""
    return np.asarray(geometry + frames * np.tile(STEP, geometry.shape[1] // 2), np.float32)


def displacements_of(
    features: list[FeatureSet], frames: list[np.ndarray], hop: int, spans: tuple[int, ...]
) -> dict[tuple[int, int], Displacement]:
    flows = neighbor_flows(frames, hop, lambda items, description: items)
    return chain_displacements(features, flows, hop, spans)


@pytest.mark.parametrize("node_type", [POINT, LINE])
def test_chain_displacements_tracks_every_span_in_both_directions(
    frames: list[np.ndarray], node_type: NodeType
) -> None:
    features = [features_at(t, node_type) for t in range(FRAMES)]
    displacements = displacements_of(features, frames, 1, (1, 2, 4))
    for (t, span), displacement in displacements.items():
        geometry = features[t].geometry
        assert displacement.tracked.shape == (len(geometry),)
        assert displacement.tracked.all()
        np.testing.assert_allclose(
            displacement.next_geometry.numpy(), shifted(geometry, span), rtol=0, atol=0.5, err_msg=f"{t} {span}"
        )


@pytest.mark.parametrize(("hop", "spans"), [(1, (1, 2, 4)), (2, (2, 4)), (2, (8,)), (3, (3,))])
def test_chain_displacements_has_every_span_within_the_demonstration(
    frames: list[np.ndarray], hop: int, spans: tuple[int, ...]
) -> None:
    features = [features_at(t) for t in range(FRAMES)]
    displacements = displacements_of(features, frames, hop, spans)
    forwards = {(t, span) for span in spans for t in range(FRAMES) if t + span < FRAMES}
    backwards = {(t, -span) for span in spans for t in range(FRAMES) if t - span >= 0}
    assert set(displacements) == forwards | backwards
    assert len(forwards) == len(backwards) > 0


@pytest.mark.parametrize("node_type", [POINT, LINE])
@pytest.mark.parametrize("hop", [1, 2])
def test_chain_displacements_of_one_hop_equals_track_between(
    frames: list[np.ndarray], hop: int, node_type: NodeType
) -> None:
    features = [features_at(t, node_type) for t in range(FRAMES)]
    displacements = displacements_of(features, frames, hop, (hop, 2 * hop))
    for t in range(FRAMES):
        for span in (hop, -hop):
            if 0 <= t + span < FRAMES:
                geometry, tracked = track_between(node_type, features[t].geometry, frames[t], frames[t + span])
                assert np.array_equal(displacements[t, span].next_geometry.numpy(), geometry)
                assert np.array_equal(displacements[t, span].tracked.numpy(), tracked)


def test_chain_displacements_of_two_hops_passes_the_frame_between(frames: list[np.ndarray]) -> None:
    features = [features_at(t) for t in range(FRAMES)]
    displacements = displacements_of(features, frames, 2, (2, 4))
    between, _ = track_between(POINT, features[6].geometry, frames[6], frames[4])
    there, _ = track_between(POINT, between, frames[4], frames[2])
    assert np.array_equal(displacements[6, -4].next_geometry.numpy(), there)


def test_chain_displacements_keeps_lost_features_lost(frames: list[np.ndarray]) -> None:
    """In one frame the right part of the picture, with the second point, is hidden."""
    hidden = 4
    frames = [frame.copy() for frame in frames]
    frames[hidden][:, 80:] = 100
    features = [feature_set(POINT, shifted(np.array([[40, 60], [110, 60]]), t)) for t in range(FRAMES)]
    displacements = displacements_of(features, frames, 1, (1, 2, 4))
    for (t, span), displacement in displacements.items():
        passed = range(t, t + span + 1) if span > 0 else range(t + span, t + 1)
        assert displacement.tracked.tolist() == [True, hidden not in passed], (t, span)
        shift = span * STEP if hidden not in passed else 0 * STEP
        np.testing.assert_allclose(displacement.next_geometry[1], features[t].geometry[1] + shift, rtol=0, atol=0.5)
        if hidden in passed:  # its original position, not the last one tracked
            assert np.array_equal(displacement.next_geometry[1].numpy(), features[t].geometry[1])


def test_chain_displacements_of_frames_without_features(frames: list[np.ndarray]) -> None:
    features = [FeatureSet.empty(LINE, 72) for _ in frames]
    displacements = displacements_of(features, frames, 2, (2, 4))
    assert len(displacements) == 2 * (7 + 5)
    assert {tuple(displacement.next_geometry.shape) for displacement in displacements.values()} == {(0, 4)}
    assert {tuple(displacement.tracked.shape) for displacement in displacements.values()} == {(0,)}


def test_tracks_to_end_are_sorted_and_end_within_a_hop_of_the_last_frame(frames: list[np.ndarray]) -> None:
    features = [features_at(t) for t in range(FRAMES)]
    flows = neighbor_flows(frames, 2, lambda items, description: items)
    tracks = tracks_to_end(features, flows, 2)
    assert [track.start for track in tracks] == list(range(FRAMES))
    assert [track.start + 2 * track.hops for track in tracks] == [8, 7] * 4 + [8]
    np.testing.assert_allclose(tracks[1].geometry, shifted(POINTS, 7), rtol=0, atol=0.7)
