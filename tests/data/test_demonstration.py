"""A demonstration as transitions: their number and order, and the displacements of their features."""

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
from geoskill.skill.build import build_skill
from geoskill.skill.spec import SkillSpec
from geoskill.tracking.flow import track_between
from geoskill.tuning import NegativesConfig, TrajectoryConfig

# A `Training` is what the fixtures of conftest.py make; see there.
Training = Any


@pytest.mark.parametrize(
    ("frames", "gap", "max_span_ratio", "spans"),
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
def test_time_spans_double_up_to_the_limit(
    frames: int, gap: int, max_span_ratio: float, spans: tuple[int, ...]
) -> None:
    assert time_spans(frames, gap, max_span_ratio) == spans


@pytest.mark.parametrize(
    ("frames", "gap", "max_span_ratio", "message"),
    [
        (100, 0, 0.5, r"^gap=0: expected at least 1$"),
        (100, -2, 0.5, r"^gap=-2: expected at least 1$"),
        (100, 2, 1.5, r"^max_span_ratio=1\.5: expected a share from 0 to 1$"),
        (100, 2, -0.1, r"^max_span_ratio=-0\.1: expected a share from 0 to 1$"),
        (100, 2, float("nan"), r"^max_span_ratio=nan: expected a share from 0 to 1$"),
        (2, 2, 0.5, r"^the demonstration has 2 frames; expected more than gap=2$"),
        (1, 1, 0.5, r"^the demonstration has 1 frames; expected more than gap=1$"),
    ],
)
def test_time_spans_rejects_bad_arguments(frames: int, gap: int, max_span_ratio: float, message: str) -> None:
    with pytest.raises(InputError, match=message):
        time_spans(frames, gap, max_span_ratio)


def frames_and_spans(demonstration: Demonstration) -> list[tuple[int, int]]:
    """First frame and span of every transition, in the documented order: by span, then by time."""
    return [(t, span) for span in demonstration.spans for t in range(20 - span)]


def test_demonstration_has_every_pair_of_frames_a_span_apart(demonstration: Demonstration) -> None:
    assert demonstration.spans == (2, 4, 8)
    assert len(demonstration) == 18 + 16 + 12
    assert len(frames_and_spans(demonstration)) == len(demonstration)


def test_transition_has_both_frames_of_every_member(
    demonstration: Demonstration, demonstration_frames: tuple[np.ndarray, ...], spec: SkillSpec
) -> None:
    pipelines = build_skill(spec).pipelines
    points = [pipelines["sift"].extract(frame).geometry for frame in demonstration_frames]
    lines = [pipelines["lbd"].extract(frame).geometry for frame in demonstration_frames]
    for index, (t, span) in enumerate(frames_and_spans(demonstration)):
        transition = demonstration[index]
        assert list(transition) == ["p2p_sift", "p2l_sift_lbd"]
        for which, frame in (("first", t), ("second", t + span)):
            alone, mixed = (transition[name][which] for name in transition)
            assert np.array_equal(alone.point_geometry.numpy(), points[frame])
            assert np.array_equal(mixed.point_geometry.numpy(), points[frame])
            assert np.array_equal(mixed.line_geometry.numpy(), lines[frame])
            for graph in (alone, mixed):
                assert graph.span_index.tolist() == [demonstration.spans.index(span)]


def test_transition_displacements_lead_to_the_other_frame(
    demonstration: Demonstration, demonstration_frames: tuple[np.ndarray, ...]
) -> None:
    for index, (t, span) in enumerate(frames_and_spans(demonstration)):
        if span != 2:  # longer spans are chained over the frames between, see test_tracks.py
            continue
        transition = demonstration[index]["p2l_sift_lbd"]
        for which, start, end in (("first", t, t + 2), ("second", t + 2, t)):
            graph = transition[which]
            for node_type in (NodeType.POINT, NodeType.LINE):
                geometry, tracked = track_between(
                    node_type,
                    graph[f"{node_type}_geometry"].numpy(),
                    demonstration_frames[start],
                    demonstration_frames[end],
                )
                assert np.array_equal(graph[f"{node_type}_next_geometry"].numpy(), geometry)
                assert np.array_equal(graph[f"{node_type}_tracked"].numpy(), tracked)


def test_transition_displacements_of_a_moving_tile(demonstration: Demonstration) -> None:
    checked = 0
    for index, (t, span) in enumerate(frames_and_spans(demonstration)):
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
        frames, parts.pipelines, parts.members, gap=gap, max_span_ratio=0.0, num_negatives=0, progress=progress
    )


def test_demonstration_reports_progress(demonstration_frames: tuple[np.ndarray, ...], spec: SkillSpec) -> None:
    reports = []

    def progress(items: Any, text: str) -> Any:
        reports.append((text, len(items)))
        return items

    demonstration_of(demonstration_frames[:4], spec, progress=progress)
    assert reports == [("extracting features", 4), ("following motion", 2)]


def test_demonstration_passes_settings_on(demonstration_frames: tuple[np.ndarray, ...], spec: SkillSpec) -> None:
    reports, parts = {}, build_skill(spec)

    def progress(items: Any, text: str) -> Any:
        reports[text] = list(items)
        return items

    demonstration = Demonstration(
        demonstration_frames[:5],
        parts.pipelines,
        parts.members,
        gap=2,
        max_span_ratio=0.0,
        num_negatives=1,
        progress=progress,
        trajectory=TrajectoryConfig(anchors=3),
        negatives=NegativesConfig(source_frames=2, leaves_per_frame=0),
    )
    for graphs in demonstration[0].values():
        assert graphs["first"].point_anchor_xy.shape[1] == 3
    assert reports["finding negatives"] == [0, 4]


@pytest.mark.slow
def test_demonstration_does_not_depend_on_threads(
    demonstration_frames: tuple[np.ndarray, ...], spec: SkillSpec
) -> None:
    parts = build_skill(spec)
    single, threaded = (
        Demonstration(
            demonstration_frames[:8],
            parts.pipelines,
            parts.members,
            gap=2,
            max_span_ratio=0.0,
            num_negatives=5,
            progress=lambda items, text: items,
            threads=threads,
        )
        for threads in (1, 3)
    )
    for index in range(len(single)):
        for name, graphs in single[index].items():
            for which, graph in graphs.items():
                other_graph = threaded[index][name][which]
                assert graph.keys() == other_graph.keys()
                for key, value in graph.items():
                    assert (
                        torch.equal(value, other_graph[key])
                        if isinstance(value, torch.Tensor)
                        else value == other_graph[key]
                    )


def test_demonstration_rejects_frames_without_instances(training_of: Callable[..., Training]) -> None:
    flat = [np.full((60, 80, 3), value, np.uint8) for value in (90, 100, 110, 120)]
    for name, types in (("p2p_sift", "point"), ("p2l_sift_lbd", "point and line")):
        spec = training_of(name).spec
        with pytest.raises(
            InputError, match=rf"no frame of the demonstration has an association of {name}; expected .* type {types} "
        ):
            demonstration_of(flat, spec)


def test_demonstration_rejects_a_gap_of_its_length(
    demonstration_frames: tuple[np.ndarray, ...], spec: SkillSpec
) -> None:
    with pytest.raises(InputError, match=r"has 5 frames; expected more than gap=5"):
        demonstration_of(demonstration_frames[:5], spec, gap=5)


def test_graph_without_negatives_limits_the_features(
    demonstration_frames: tuple[np.ndarray, ...], spec: SkillSpec, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The strongest and the weakest are among them; a training step has all features."""
    demonstration = demonstration_of(demonstration_frames[:4], spec)
    name = "p2p_sift"
    complete = demonstration.graph_without_negatives(name, 0)
    count = complete.node_count(NodeType.POINT)
    assert count == 10
    assert complete.instance_index.shape[1] == count * (count - 1) // 2
    monkeypatch.setattr(geoskill.data.demonstration, "MAX_FIT_FEATURES", 5)
    limited = demonstration.graph_without_negatives(name, 0)
    chosen = [0, 2, 4, 7, 9]  # 0, 2.25, 4.5, 6.75 and 9, rounded
    for attribute in ("geometry", "descriptor", "next_geometry", "tracked", "anchor_xy", "final_xy"):
        assert torch.equal(limited[f"point_{attribute}"], complete[f"point_{attribute}"][chosen]), attribute
    assert limited.instance_index.T.tolist() == [[i, j] for i in range(5) for j in range(i + 1, 5)]
    assert demonstration[0][name]["first"].node_count(NodeType.POINT) == count
