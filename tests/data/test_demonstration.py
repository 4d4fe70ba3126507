"""A demonstration as transitions: which there are, and that each graph moves to the right frame."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import pytest
import torch

import geoskill.data.demonstration
from geoskill.data.demonstration import Demonstration, time_spans
from geoskill.errors import InputError
from geoskill.geometry.primitives import NodeType
from geoskill.io.prefetch import Progress
from geoskill.skill.spec import SkillSpec, build_skill
from geoskill.tracking.flow import track_between

# A `Training` is what the fixtures of conftest.py make; see there.
Training = Any


@pytest.mark.parametrize(
    ("frames", "gap", "horizon", "spans"),
    [
        (100, 2, 0.5, (2, 4, 8, 16, 32)),  # half of 99 is 49.5
        (65, 2, 0.5, (2, 4, 8, 16, 32)),  # half of 64 is 32 exactly
        (64, 2, 0.5, (2, 4, 8, 16)),
        (9, 1, 1.0, (1, 2, 4, 8)),
        (8, 1, 1.0, (1, 2, 4)),
        (100, 3, 0.1, (3, 6)),
        (100, 2, 0.0, (2,)),
        (3, 2, 1.0, (2,)),
        (100, 40, 0.2, (40,)),
    ],
)
def test_spans_double_up_to_the_horizon(frames: int, gap: int, horizon: float, spans: tuple[int, ...]) -> None:
    assert time_spans(frames, gap, horizon) == spans


@pytest.mark.parametrize(
    ("frames", "gap", "horizon", "message"),
    [
        (100, 0, 0.5, r"^demonstration\.gap=0: expected at least 1$"),
        (100, -2, 0.5, r"^demonstration\.gap=-2: expected at least 1$"),
        (100, 2, 1.5, r"^demonstration\.horizon=1\.5: expected a share from 0 to 1$"),
        (100, 2, -0.1, r"^demonstration\.horizon=-0\.1: expected a share from 0 to 1$"),
        (100, 2, float("nan"), r"^demonstration\.horizon=nan: expected a share from 0 to 1$"),
        (2, 2, 0.5, r"^the demonstration has 2 frames; expected more than demonstration\.gap=2$"),
        (1, 1, 0.5, r"^the demonstration has 1 frames; expected more than demonstration\.gap=1$"),
    ],
)
def test_spans_that_cannot_be(frames: int, gap: int, horizon: float, message: str) -> None:
    with pytest.raises(InputError, match=message):
        time_spans(frames, gap, horizon)


def places(demonstration: Demonstration) -> list[tuple[int, int]]:
    """First frame and span of each transition, in the order documented: by span, then by time."""
    return [(t, span) for span in demonstration.spans for t in range(20 - span)]


def test_every_pair_of_frames_a_span_apart_is_a_transition(demonstration: Demonstration) -> None:
    assert demonstration.spans == (2, 4, 8)
    assert len(demonstration) == 18 + 16 + 12
    assert len(places(demonstration)) == len(demonstration)


def test_a_transition_has_both_frames_of_every_member(
    demonstration: Demonstration, demonstration_frames: tuple[np.ndarray, ...], spec: SkillSpec
) -> None:
    pipelines = build_skill(spec).pipelines
    points = [pipelines["sift"].extract(frame).geometry for frame in demonstration_frames]
    lines = [pipelines["lbd"].extract(frame).geometry for frame in demonstration_frames]
    for index, (t, span) in enumerate(places(demonstration)):
        transition = demonstration[index]
        assert list(transition) == ["p2p_sift", "p2l_sift_lbd"]
        for which, frame in (("first", t), ("second", t + span)):
            alone, mixed = (transition[name][which] for name in transition)
            assert np.array_equal(alone.point_geometry.numpy(), points[frame])
            assert np.array_equal(mixed.point_geometry.numpy(), points[frame])
            assert np.array_equal(mixed.line_geometry.numpy(), lines[frame])
            for graph in (alone, mixed):
                assert graph.span_index.tolist() == [demonstration.spans.index(span)]


def test_the_first_frame_moves_to_the_second_and_the_second_to_the_first(
    demonstration: Demonstration, demonstration_frames: tuple[np.ndarray, ...]
) -> None:
    for index, (t, span) in enumerate(places(demonstration)):
        if span != 2:  # longer ones go over the frames between, which test_tracks.py tells
            continue
        transition = demonstration[index]["p2l_sift_lbd"]
        for which, start, end in (("first", t, t + 2), ("second", t + 2, t)):
            graph = transition[which]
            for kind in NodeType:
                geometry, followed = track_between(
                    kind, graph[f"{kind}_geometry"].numpy(), demonstration_frames[start], demonstration_frames[end]
                )
                assert np.array_equal(graph[f"{kind}_next_geometry"].numpy(), geometry)
                assert np.array_equal(graph[f"{kind}_tracked"].numpy(), followed)


def test_the_moving_tile_moves_and_the_others_rest(demonstration: Demonstration) -> None:
    checked = 0
    for index, (t, span) in enumerate(places(demonstration)):
        for which, frame, sign in (("first", t, 1), ("second", t + span, -1)):
            graph = demonstration[index]["p2p_sift"][which]
            kept = graph.point_geometry[graph.point_tracked]
            motion = graph.point_next_geometry[graph.point_tracked] - kept
            x, y = kept.T - torch.tensor([[2.5 * frame], [0.0]])
            inner = (x > 33) & (x < 55) & (y > 51) & (y < 73)  # of the moving tile, away from its border
            expected = torch.tensor([sign * 2.5 * span, 0.0]).expand_as(motion[inner])
            torch.testing.assert_close(motion[inner], expected, rtol=0, atol=0.75)
            below = kept[:, 1] > 93
            assert (motion[below].abs() < 0.25).all()
            checked += int(inner.sum()) + int(below.sum())
    assert checked > 200


def demonstration_of(
    frames: Sequence[np.ndarray],
    spec: SkillSpec,
    gap: int = 2,
    progress: Progress = lambda items, text: items,
) -> Demonstration:
    """Transitions over the gap alone, without negatives."""
    parts = build_skill(spec)
    return Demonstration(
        frames, parts.pipelines, parts.members, gap=gap, horizon=0.0, num_negatives=0, progress=progress
    )


def test_progress_is_told(demonstration_frames: tuple[np.ndarray, ...], spec: SkillSpec) -> None:
    told = []

    def progress(items: Any, text: str) -> Any:
        told.append((text, len(items)))
        return items

    demonstration_of(demonstration_frames[:4], spec, progress=progress)
    assert told == [("extracting features", 4), ("following motion", 2)]


@pytest.mark.slow
def test_threads_change_nothing(demonstration_frames: tuple[np.ndarray, ...], spec: SkillSpec) -> None:
    parts = build_skill(spec)
    one, three = (
        Demonstration(
            demonstration_frames[:8],
            parts.pipelines,
            parts.members,
            gap=2,
            horizon=0.0,
            num_negatives=5,
            progress=lambda items, text: items,
            threads=threads,
        )
        for threads in (1, 3)
    )
    for index in range(len(one)):
        for name, graphs in one[index].items():
            for which, graph in graphs.items():
                other = three[index][name][which]
                assert graph.keys() == other.keys()
                for key, value in graph.items():
                    assert torch.equal(value, other[key]) if isinstance(value, torch.Tensor) else value == other[key]


def test_frames_without_any_association_are_refused(training_of: Callable[..., Training]) -> None:
    flat = [np.full((60, 80, 3), value, np.uint8) for value in (90, 100, 110, 120)]
    for name, types in (("p2p_sift", "point"), ("p2l_sift_lbd", "point and line")):
        spec = training_of(name).spec
        with pytest.raises(
            InputError, match=rf"no frame of the demonstration has an association of {name}; expected .* type {types} "
        ):
            demonstration_of(flat, spec)


def test_a_gap_longer_than_the_demonstration_is_refused(
    demonstration_frames: tuple[np.ndarray, ...], spec: SkillSpec
) -> None:
    with pytest.raises(InputError, match=r"has 5 frames; expected more than demonstration\.gap=5"):
        demonstration_of(demonstration_frames[:5], spec, gap=5)


def test_of_very_many_features_some_are_observed(
    demonstration_frames: tuple[np.ndarray, ...], spec: SkillSpec, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of all strengths, the strongest and the weakest among them; a step has all of them."""
    found = demonstration_of(demonstration_frames[:4], spec)
    name = "p2p_sift"
    complete = found.graph_without_negatives(name, 0)
    count = complete.node_count(NodeType.POINT)
    assert count == 10
    assert complete.instance_index.shape[1] == count * (count - 1) // 2
    monkeypatch.setattr(geoskill.data.demonstration, "MAX_FIT_FEATURES", 5)
    seen = found.graph_without_negatives(name, 0).instance_index
    assert seen.shape[1] == 10
    assert (seen.min(), seen.max(), len(seen.unique())) == (0, count - 1, 5)
    assert found[0][name]["first"].node_count(NodeType.POINT) == count
