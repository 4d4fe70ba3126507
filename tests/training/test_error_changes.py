"""Changes of control errors over a transition by hand, and the scale of the reward fitted to them."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import torch

from geoskill.config import ObjectiveConfig
from geoskill.data.demonstration import Demonstration
from geoskill.errors import InputError
from geoskill.features.feature_set import FeatureSet
from geoskill.geometry.primitives import NodeType
from geoskill.graphs.motif_graph import MotifGraph, motif_graph
from geoskill.kernels.kernel import Kernel
from geoskill.kernels.p2l import PointToLine
from geoskill.kernels.p2p import PointToPoint
from geoskill.model.bilinear import Bilinear
from geoskill.model.kernel_model import KernelModel
from geoskill.model.scorer import Motif
from geoskill.objective.goal import UNRELATED_PROGRESS, goal_progress
from geoskill.tracking.motion import Displacement, Part, Trajectory
from geoskill.training.error_changes import error_changes, fit_reward_scale, instance_goal_progress

# What the fixtures of conftest.py make; see there.
Training = Any
HandMade = Any

POINT, LINE = NodeType.POINT, NodeType.LINE
EXTRACTORS = {POINT: "sift", LINE: "lbd"}


def member_of(kernel: Kernel) -> KernelModel:
    extractors = {node_type: EXTRACTORS[node_type] for node_type in dict.fromkeys(kernel.roles)}
    return KernelModel(kernel, extractors, Bilinear(Motif.of(kernel, dict.fromkeys(extractors, 4)), hidden_dim=2))


def graph_of(
    kernel: Kernel, nodes: dict[NodeType, tuple[list[list[float]], list[list[float]], list[bool]]]
) -> MotifGraph:
    """Build a graph from the geometry, next geometry and tracked flags of each node type."""
    features = {
        node_type: FeatureSet(
            node_type,
            np.eye(len(geometry), 4, dtype=np.float32),
            np.array(geometry, np.float32),
            np.zeros(len(geometry), np.float32),
        )
        for node_type, (geometry, _, _) in nodes.items()
    }
    motion = {
        node_type: Displacement(torch.tensor(moved, dtype=torch.float32), torch.tensor(tracked))
        for node_type, (_, moved, tracked) in nodes.items()
    }
    return motif_graph(kernel, features, motion)


def three_points(tracked: list[bool]) -> MotifGraph:
    """The first comes 5 px closer to the second, 10 px away; the third, 24 px below the first, stays."""
    return graph_of(PointToPoint(), {POINT: ([[0, 0], [10, 0], [0, 24]], [[5, 0], [10, 0], [0, 24]], tracked)})


def test_error_changes_absolute_by_hand() -> None:
    # 10 -> 5; 24 -> sqrt(601); 26 -> 26
    changes = error_changes(member_of(PointToPoint()), three_points([True] * 3), "absolute")
    torch.testing.assert_close(changes, torch.tensor([-5.0, 601**0.5 - 24, 0.0]))


def test_error_changes_relative_by_hand() -> None:
    # Over the sum of both and 4 px, the resolution of p2p being 1 px.
    changes = error_changes(member_of(PointToPoint()), three_points([True] * 3), "relative")
    far = (601**0.5 - 24) / (601**0.5 + 24 + 4)
    torch.testing.assert_close(changes, torch.tensor([-5 / 19, far, 0.0]))


@pytest.mark.parametrize("change", ["absolute", "relative"])
def test_error_changes_are_zero_without_tracking(change: Any) -> None:
    member = member_of(PointToPoint())
    full = error_changes(member, three_points([True] * 3), change)
    assert (full[:2].abs() > 0.005).all()
    for tracked, known in (
        ([False, True, True], [False, False, True]),
        ([True, False, True], [False, True, False]),
        ([True, True, False], [True, False, False]),
        ([False, False, False], [False, False, False]),
    ):
        changes = error_changes(member, three_points(tracked), change)
        assert torch.equal(changes, torch.where(torch.tensor(known), full, 0.0))


def test_error_changes_need_both_node_types_tracked() -> None:
    kernel = PointToLine()
    # A point comes from 8 to 3 px above a line, and from 6 to 1 px above a second one that was not tracked.
    lines = [[0, 8, 20, 8], [0, 6, 20, 6]]
    graph = graph_of(kernel, {POINT: ([[4, 0]], [[4, 5]], [True]), LINE: (lines, lines, [True, False])})
    torch.testing.assert_close(error_changes(member_of(kernel), graph, "absolute"), torch.tensor([-5.0, 0.0]))


def approach(span_index: int, start: float, end: float) -> MotifGraph:
    """One pair of points whose distance goes from ``start`` to ``end`` pixels."""
    graph = graph_of(PointToPoint(), {POINT: ([[0, 0], [start, 0]], [[0, 0], [end, 0]], [True, True])})
    graph.span_index = torch.tensor([span_index])
    return graph


def test_reward_scale_has_one_beta_per_span(hand_made: HandMade) -> None:
    member = member_of(PointToPoint())
    demonstration = hand_made(
        (2, 4, 8),
        [
            approach(0, 10, 8),
            approach(0, 10, 4),
            approach(0, 10, 9.5),  # at rest, half a pixel being below the resolution
            approach(1, 30, 24),
            approach(1, 30, 42),
            approach(2, 20, 20.25),  # nothing moves over this span
        ],
    )
    fit_reward_scale({"p2p_sift": member}, demonstration, ObjectiveConfig(change="absolute", beta_scale=3.0))
    assert member.spans.tolist() == [2, 4, 8]
    # 3 over the medians (2 + 6) / 2 and (6 + 12) / 2
    torch.testing.assert_close(member.beta, torch.tensor([3 / 4, 3 / 9, 0.0]))


def test_reward_scale_uses_instances_that_move_in_pixels(hand_made: HandMade) -> None:
    member = member_of(PointToPoint())
    # The first pair moves by half a pixel only, though that is a large part of its distance.
    demonstration = hand_made((2,), [approach(0, 0.6, 0.1), approach(0, 20, 10), approach(0, 40, 20)])
    fit_reward_scale({"p2p_sift": member}, demonstration, ObjectiveConfig(change="relative", beta_scale=1.5))
    median = (10 / 34 + 20 / 64) / 2
    torch.testing.assert_close(member.beta, torch.tensor([1.5 / median]))


def test_reward_scale_rejects_a_demonstration_at_rest(hand_made: HandMade) -> None:
    member = member_of(PointToPoint())
    demonstration = hand_made((2, 4), [approach(0, 10, 9.5), approach(1, 30, 30)])
    with pytest.raises(
        InputError,
        match=r"^nothing moves in the demonstration: no p2p_sift association .* more than 1; expected a video",
    ):
        fit_reward_scale({"p2p_sift": member}, demonstration, ObjectiveConfig())
    assert member.beta.shape == (0,)


def test_reward_scale_rejects_a_video_at_rest(
    training_of: Callable[..., Training], demonstration_frames: tuple[np.ndarray, ...]
) -> None:
    still = type(training_of("p2p_sift"))([demonstration_frames[4]] * 5, training_of("p2p_sift").spec)
    with pytest.raises(InputError, match="nothing moves in the demonstration"):
        still.module()


def test_reward_scale_gives_the_median_change_its_reward(training: Training, demonstration: Demonstration) -> None:
    members = training.members()
    fit_reward_scale(members, demonstration, ObjectiveConfig(beta_scale=1.5))
    for name, member in members.items():
        for span_index, beta in enumerate(member.beta):
            sizes = []
            for index in range(len(demonstration)):
                graph = demonstration.graph_without_negatives(name, index)
                if int(graph.span_index) == span_index:
                    moving = error_changes(member, graph, "absolute").abs() > member.kernel.resolution
                    sizes.append(error_changes(member, graph, "relative").abs()[moving])
            rewards = torch.tanh(beta / 2 * torch.cat(sizes))
            assert float(rewards.quantile(0.5)) == pytest.approx(np.tanh(0.75), rel=1e-3)


def graph_with_trajectories(
    trajectory: dict[NodeType, Trajectory], kernel: Kernel, geometry: dict[NodeType, list[list[float]]]
) -> MotifGraph:
    """Build a frame's graph with trajectories and without displacements."""
    features = {
        node_type: FeatureSet(
            node_type,
            np.eye(len(rows), 4, dtype=np.float32),
            np.array(rows, np.float32),
            np.zeros(len(rows), np.float32),
        )
        for node_type, rows in geometry.items()
    }
    return motif_graph(kernel, features, trajectory=trajectory)


def test_instance_goal_progress_by_hand() -> None:
    """Two anchors. The first point comes from (0, 0) and is known since the first anchor; the second rests at (100, 0)
    and is known since the second; the third is known at no anchor, and the end of the fourth is unknown."""
    xy = [[40.0, 0], [100, 0], [100, 50], [0, 100]]
    anchor_xy = torch.tensor([[[0.0, 0], [10, 0]], [[100, 0], [100, 0]], [[100, 50], [100, 50]], [[0, 100], [0, 100]]])
    final = torch.tensor([[97.0, 0], [100, 0], [100, 50], [0, 100]])
    trajectory = Trajectory(
        anchor_xy,
        torch.tensor([0, 1, 2, 0]),
        final,
        torch.tensor([True, True, True, False]),
        torch.zeros(4, dtype=torch.long),
    )
    graph = graph_with_trajectories({POINT: trajectory}, PointToPoint(), {POINT: xy})
    values = instance_goal_progress(member_of(PointToPoint()), graph).tolist()
    progress_of = dict(zip(map(tuple, graph.instance_index.T.tolist()), values, strict=True))

    def expected_progress(before: float, after: float) -> float:
        return float(
            goal_progress(torch.tensor([float(before)]), torch.tensor([float(after)]), torch.tensor([True]), 1.0)
        )

    assert progress_of[0, 1] == pytest.approx(expected_progress(90, 3)), (
        "90 px at the second anchor, 60 px now, 3 px in the end"
    )
    assert progress_of[0, 2] == pytest.approx(expected_progress(math.hypot(60, 50), math.hypot(3, 50))), (
        "its past is unknown"
    )
    assert progress_of[1, 2] == pytest.approx(0, abs=1e-6), "both rest"
    assert progress_of[0, 3] == progress_of[1, 3] == progress_of[2, 3] == 0


def test_instance_goal_progress_counts_from_the_larger_error() -> None:
    anchor_xy = torch.tensor([[[95.0, 0]], [[100, 0]]])
    trajectory = Trajectory(
        anchor_xy,
        torch.tensor([0, 0]),
        torch.tensor([[100.0, 0], [100, 0]]),
        torch.tensor([True, True]),
        torch.zeros(2, dtype=torch.long),
    )
    graph = graph_with_trajectories({POINT: trajectory}, PointToPoint(), {POINT: [[20.0, 0], [100, 0]]})
    expected = goal_progress(torch.tensor([80.0]), torch.tensor([0.0]), torch.tensor([True]), 1.0)
    torch.testing.assert_close(instance_goal_progress(member_of(PointToPoint()), graph), expected)


def test_instances_that_cannot_define_the_task_have_the_least_progress() -> None:
    """Two features of the thing seem to come together where one is taken for the other."""
    part = torch.tensor([Part.THING, Part.BACKGROUND, Part.UNRELATED, Part.THING, Part.BACKGROUND, Part.UNKNOWN])
    anchor_xy = torch.tensor([[[0.0, 0]], [[100, 0]], [[50, 0]], [[0, 40]], [[100, 90]], [[0, 100]]])
    final_xy = torch.tensor([[100.0, 0]]).repeat(6, 1)
    trajectory = Trajectory(anchor_xy, torch.zeros(6).long(), final_xy, torch.ones(6).bool(), part)
    graph = graph_with_trajectories({POINT: trajectory}, PointToPoint(), {POINT: anchor_xy[:, 0].tolist()})
    progress = instance_goal_progress(member_of(PointToPoint()), graph)
    pairs = [tuple(pair) for pair in graph.instance_index.T.tolist()]
    hopeless = {(0, 3), (1, 4), *((i, j) for i, j in pairs if 2 in (i, j))}
    least = {pair for pair, value in zip(pairs, progress.tolist(), strict=True) if value == UNRELATED_PROGRESS}
    assert least == hopeless
    assert progress[pairs.index((0, 1))] > 0.5


def test_instance_goal_progress_of_a_point_and_a_line() -> None:
    """A point 30 px above a horizontal line; it was 50 px above it, and ends 2 px below."""
    yes, unknown = torch.tensor([True]), torch.tensor([int(Part.UNKNOWN)])
    points = Trajectory(torch.tensor([[[5.0, -50]]]), torch.tensor([0]), torch.tensor([[5.0, 2]]), yes, unknown)
    line = torch.tensor([[0.0, 0, 10, 0]])
    lines = Trajectory(line[:, None], torch.tensor([0]), line, yes, unknown)
    graph = graph_with_trajectories(
        {POINT: points, LINE: lines}, PointToLine(), {POINT: [[5.0, -30]], LINE: line.tolist()}
    )
    member = member_of(PointToLine())
    expected = goal_progress(torch.tensor([50.0]), torch.tensor([2.0]), torch.tensor([True]), member.kernel.resolution)
    torch.testing.assert_close(instance_goal_progress(member, graph), expected)
