"""The order of nodes: against plain least squares, by hand, and on a demonstration."""

from typing import Any

import numpy as np
import pytest
import torch

from geoskill.config import ObjectiveConfig
from geoskill.features.feature_set import FeatureSet
from geoskill.geometry.primitives import NodeType
from geoskill.graphs.motif_graph import MotifGraph, motif_graph
from geoskill.kernels.kernel import Kernel
from geoskill.kernels.l2l import LineToLine
from geoskill.kernels.p2l import PointToLine
from geoskill.kernels.p2p import PointToPoint
from geoskill.model.bilinear import Bilinear
from geoskill.model.kernel_model import KernelModel
from geoskill.model.scorer import Motif
from geoskill.tracking.motion import Displacement
from geoskill.training.node_order import MIN_NOISE, fit_node_order

# What the fixtures of conftest.py make; see there.
Training = Any
HandMade = Any

WIDTH = 4
OBJECTIVE = ObjectiveConfig()


def member_of(kernel: Kernel, beta: float = 2.0) -> KernelModel:
    extractors = {node_type: str(node_type) for node_type in dict.fromkeys(kernel.roles)}
    member = KernelModel(kernel, extractors, Bilinear(Motif.of(kernel, dict.fromkeys(extractors, WIDTH)), hidden_dim=2))
    member.set_reward_scale(torch.tensor([2]), torch.tensor([beta]))
    return member


def graph_of(kernel: Kernel, descriptors: np.ndarray, before: np.ndarray, after: np.ndarray) -> MotifGraph:
    """Build a frame whose features, of the kernel's only node type, are tracked from ``before`` to ``after``."""
    node_type = kernel.roles[0]
    features = FeatureSet(
        node_type, descriptors.astype(np.float32), before.astype(np.float32), np.zeros(len(before), "f4")
    )
    motion = Displacement(torch.tensor(after, dtype=torch.float32), torch.ones(len(after), dtype=torch.bool))
    graph = motif_graph(kernel, {node_type: features}, {node_type: motion})
    graph.span_index = torch.tensor([0])
    return graph


def unit(rows: np.ndarray) -> np.ndarray:
    return rows / np.linalg.norm(rows, axis=1, keepdims=True)


@pytest.mark.parametrize("noise", [0.0, 0.5])
def test_node_order_is_the_weighted_ridge_regression(noise: float, hand_made: HandMade) -> None:
    random = np.random.default_rng(0)
    kernel = PointToPoint()
    scenes = [
        (unit(random.normal(size=(5, WIDTH))), random.uniform(0, 99, (5, 2)), random.uniform(0, 99, (5, 2)))
        for _ in range(3)
    ]
    member = member_of(kernel)
    fit_node_order(
        {"member": member}, hand_made((2,), [graph_of(kernel, *scene) for scene in scenes]), OBJECTIVE, noise
    )
    rows, wanted, weights = [], [], []
    for descriptors, before, after in scenes:
        distance = np.linalg.norm(after - before, axis=1)
        for i in range(5):
            for j in range(i + 1, 5):
                old, new = np.linalg.norm(before[i] - before[j]), np.linalg.norm(after[i] - after[j])
                rows.append(descriptors[i] - descriptors[j])
                wanted.append((distance[i] - distance[j]) / (distance[i] + distance[j] + 4))
                weights.append(max(0.0, np.tanh((old - new) / (old + new + 4))))
    x, y, w = np.array(rows), np.array(wanted), np.array(weights)
    ridge = 2 * w.sum() * max(noise, MIN_NOISE) ** 2 / WIDTH
    expected = np.linalg.solve(x.T @ (w[:, None] * x) + ridge * np.eye(WIDTH), x.T @ (w * y))
    np.testing.assert_allclose(member.node_order.numpy(), expected, rtol=1e-4, atol=1e-5)


@pytest.mark.parametrize("kernel", [PointToPoint(), LineToLine()], ids=lambda kernel: kernel.name)
@pytest.mark.parametrize("moving", [0, 1])
def test_moving_node_first_does_not_depend_on_the_order_of_features(
    kernel: Kernel, moving: int, hand_made: HandMade
) -> None:
    width = kernel.roles[0].geometry_dim
    before = np.array([[10.0, 10.0, 30.0, 10.0], [12.0, 60.0, 33.0, 60.0]])[:, :width]
    after = before.copy()
    after[moving, 1::2] = before[1 - moving, 1::2] + 1.0
    descriptors = np.eye(2, WIDTH)
    member = member_of(kernel)
    fit_node_order({"member": member}, hand_made((2,), [graph_of(kernel, descriptors, before, after)]), OBJECTIVE, 0.5)
    for order in ([0, 1], [1, 0]):
        graph = graph_of(kernel, descriptors[order], before[order], after[order])
        first = int(member.moving_node_first(graph, graph.instance_index)[0, 0])
        assert order[first] == moving


def test_moving_node_first_without_node_order_keeps_the_order(hand_made: HandMade) -> None:
    before, after = np.array([[0.0, 0.0], [9.0, 0.0]]), np.array([[5.0, 0.0], [9.0, 0.0]])
    kernel = PointToPoint()
    graph = graph_of(kernel, np.eye(2, WIDTH), before, after)
    untrained, still = member_of(kernel), member_of(kernel, beta=0.0)
    fit_node_order({"member": still}, hand_made((2,), [graph]), OBJECTIVE, 0.5)
    for member in (untrained, still):
        assert len(member.node_order) == 0
        assert torch.equal(member.moving_node_first(graph, graph.instance_index), graph.instance_index)
    torch.testing.assert_close(
        untrained.moving_node_first(graph, graph.instance_index[:, :0]), graph.instance_index[:, :0]
    )


def test_node_order_ignores_frames_without_features(hand_made: HandMade) -> None:
    kernel = PointToPoint()
    before, after = np.array([[0.0, 0.0], [9.0, 0.0]]), np.array([[5.0, 0.0], [9.0, 0.0]])
    full = graph_of(kernel, np.eye(2, WIDTH), before, after)
    empty = graph_of(kernel, np.zeros((0, WIDTH)), before[:0], after[:0])
    with_empty, without = member_of(kernel), member_of(kernel)
    fit_node_order({"member": with_empty}, hand_made((2,), [empty, full, empty]), OBJECTIVE, 0.5)
    fit_node_order({"member": without}, hand_made((2,), [full]), OBJECTIVE, 0.5)
    torch.testing.assert_close(with_empty.node_order, without.node_order)


def test_moving_node_first_keeps_the_order_of_equal_features() -> None:
    kernel = PointToPoint()
    member = member_of(kernel)
    member.set_node_order(torch.ones(WIDTH))
    graph = graph_of(kernel, np.repeat(np.eye(1, WIDTH), 3, axis=0), np.eye(3, 2), np.eye(3, 2))
    assert torch.equal(member.moving_node_first(graph, graph.instance_index), graph.instance_index)


def test_node_order_is_empty_for_distinct_nodes(hand_made: HandMade) -> None:
    member = member_of(PointToLine())
    fit_node_order({"member": member}, hand_made((2,), []), OBJECTIVE, 0.5)
    assert len(member.node_order) == 0


def test_node_order_of_a_demonstration(training: Training) -> None:
    members = training.members()
    training.module(members)
    fit_node_order(members, training.demonstration, OBJECTIVE, 0.5)
    for name, member in members.items():
        width = member.scorer.motif.descriptor_dims[NodeType.POINT] if name == "p2p_sift" else 0
        assert member.node_order.shape == (width,)
        assert torch.isfinite(member.node_order).all()
