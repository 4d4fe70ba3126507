"""The error is the same whatever the order of features, nodes and end points, for every kernel."""

import math
from itertools import pairwise

import numpy as np
import pytest
import torch
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from torch import Tensor

from geoskill.features.feature_set import FeatureSet
from geoskill.geometry.primitives import NodeType
from geoskill.geometry.segments import directed, direction, length, reversed_ends, turned
from geoskill.geometry.uncertainty import DETECTION_STD_PX, propagated_std
from geoskill.graphs.motif_graph import motif_graph
from geoskill.kernels.kernel import Kernel, automorphisms, directed_nodes, error_row_names, reference_line
from geoskill.model.bilinear import Bilinear
from geoskill.model.kernel_model import KernelModel
from geoskill.model.scorer import Motif
from geoskill.plugins import KERNELS
from geoskill.skill.scored_frame import ScoredInstances

POINT, LINE = NodeType.POINT, NodeType.LINE
WIDTH = 6
COUNT = 5
KERNEL_NAMES = ("p2p", "p2l", "l2l", "par")
several_examples = settings(max_examples=25, deadline=None)
seeds = st.integers(0, 2**31 - 1)
angles = st.floats(-math.pi, math.pi)


def kernel_of(name: str) -> Kernel:
    kernel = KERNELS.build(name, {})()
    assert isinstance(kernel, Kernel)
    return kernel


def member_of(kernel: Kernel, random: np.random.Generator) -> KernelModel:
    extractors = {kind: {POINT: "sift", LINE: "lbd"}[kind] for kind in dict.fromkeys(kernel.roles)}
    member = KernelModel(kernel, extractors, Bilinear(Motif.of(kernel, dict.fromkeys(extractors, WIDTH)), hidden_dim=2))
    member.set_node_order(torch.from_numpy(random.normal(size=WIDTH).astype(np.float32)))
    angle = random.uniform(-np.pi, np.pi)
    member.set_reference_axis(torch.tensor([np.cos(angle), np.sin(angle)], dtype=torch.float32))
    return member


def errors_of(member: KernelModel, features: dict[NodeType, FeatureSet], labels: dict[NodeType, list[int]]) -> object:
    """Return the error of every instance by the labels of its features in their roles, moving node first."""
    graph = motif_graph(member.kernel, features)
    scores = torch.zeros(graph.instance_index.shape[1])
    listed = ScoredInstances("m", member, graph, scores, torch.softmax(scores, 0)).associations(range(len(scores)))
    return {
        tuple(labels[node.node_type][node.feature or 0] for node in association.nodes): (
            association.error,
            association.error_std,
            tuple(node.coordinates for node in association.nodes),
        )
        for association in listed
    }


@pytest.mark.parametrize("name", KERNEL_NAMES)
@several_examples
@given(seed=seeds)
def test_error_is_bit_equal_after_relabeling_and_exchanged_end_points(name: str, seed: int) -> None:
    random = np.random.default_rng(seed)
    member = member_of(kernel_of(name), random)
    features, relabeled, labels, permuted = {}, {}, {}, {}
    for kind in member.node_types:
        descriptors = random.normal(size=(COUNT, WIDTH)).astype(np.float32)
        geometry = random.uniform(0, 200, (COUNT, kind.geometry_dim)).astype(np.float32)
        features[kind] = FeatureSet(kind, descriptors, geometry, np.zeros(COUNT, np.float32))
        order = random.permutation(COUNT)
        other = geometry[order]
        if kind is LINE:
            exchanged = random.random(COUNT) < 0.5
            other[exchanged] = other[exchanged][:, [2, 3, 0, 1]]
        relabeled[kind] = FeatureSet(kind, descriptors[order], other, np.zeros(COUNT, np.float32))
        labels[kind], permuted[kind] = list(range(COUNT)), order.tolist()
    assert errors_of(member, features, labels) == errors_of(member, relabeled, permuted)


@pytest.mark.parametrize("name", KERNEL_NAMES)
@several_examples
@given(seed=seeds, axis_angle=angles)
def test_error_is_continuous_where_no_line_turns_round(name: str, seed: int, axis_angle: float) -> None:
    kernel, random = kernel_of(name), np.random.default_rng(seed)
    axis = torch.tensor([[math.cos(axis_angle), math.sin(axis_angle)]], dtype=torch.float64)
    nodes = [torch.from_numpy(random.uniform(0, 200, (1, role.geometry_dim))) for role in kernel.roles]
    segments = [rows for rows in nodes if rows.shape[1] == 4]
    directions = [*(direction(rows) for rows in segments), axis]
    # Beside a right angle, either direction of a line is as good as the other.
    assume(all(abs(float((first * second).sum())) > 0.05 for first, second in pairwise(directions)))
    assume(all(float(length(rows)) > 20 for rows in segments))
    step = 1e-4
    moved = [rows + step * torch.from_numpy(random.uniform(-1, 1, rows.shape)) for rows in nodes]

    def error(given: list[Tensor]) -> Tensor:
        return kernel.control_error(directed_nodes(kernel, given, axis))

    slope = propagated_std(kernel.control_error, directed_nodes(kernel, nodes, axis)) / DETECTION_STD_PX
    change = (error(moved) - error(nodes)).abs()
    assert (change <= step * (math.sqrt(8) * slope + 0.1)).all()


@several_examples
@given(angle=angles, axis_angle=angles)
def test_directed_segment_has_a_positive_product_with_the_axis(angle: float, axis_angle: float) -> None:
    segment = torch.tensor([[3.0, 4.0, 3.0 + math.cos(angle), 4.0 + math.sin(angle)]], dtype=torch.float64)
    axis = torch.tensor([[math.cos(axis_angle), math.sin(axis_angle)]], dtype=torch.float64)
    result = directed(segment, axis)
    assert torch.equal(result, directed(reversed_ends(segment), axis))
    assert float((direction(result) * axis).sum()) >= 0


def test_segment_across_the_axis_is_directed_whatever_its_end_points() -> None:
    axis = torch.tensor([[0.0, 2.0]])
    segment = torch.tensor([[1.0, 5.0, 4.0, 5.0]])
    assert directed(segment, axis).tolist() == directed(reversed_ends(segment), axis).tolist() == [[4.0, 5.0, 1.0, 5.0]]


def test_axis_follows_a_line_that_turns_all_the_way_round() -> None:
    axis, line = torch.tensor([[0.0, 1.0]]), torch.tensor([[0.0, 0.0, 10.0, 3.0]])
    start = math.atan2(3, 10)
    for step in range(1, 37):
        angle = start + math.radians(10 * step)
        ends = torch.tensor([[0.0, 0.0, math.cos(angle), math.sin(angle)]])
        later = ends if step % 2 else reversed_ends(ends)
        axis = turned(axis, line, later)
        expected = math.radians(90 + 10 * step)
        assert axis[0].tolist() == pytest.approx([math.cos(expected), math.sin(expected)], abs=1e-4)
        line = later


def test_turned_leaves_the_axis_beside_a_degenerate_segment() -> None:
    axis = torch.tensor([[0.6, 0.8]])
    assert turned(axis, torch.zeros(1, 4), torch.tensor([[0.0, 0.0, 5.0, 0.0]])).tolist() == axis.tolist()


@pytest.mark.parametrize(
    ("name", "nodes", "expected"),
    [
        # d = |x - y| in each component: two coordinates of 0.5 px.
        ("p2p", [[[10.0, 2.0]], [[4.0, 9.0]]], [0.5 * math.sqrt(2), 0.5 * math.sqrt(2)]),
        # Halfway along a line of 10 px: 0.5 px of the point, 0.5 / sqrt(2) of the line.
        ("p2l", [[[5.0, 3.0]], [[0.0, 0.0, 10.0, 0.0]]], [0.5 * math.sqrt(1 + 0.5)]),
        # The sine of 0 changes by an end point's way over the length, 4 end points.
        ("par", [[[0.0, 5.0, 10.0, 5.0]], [[0.0, 0.0, 10.0, 0.0]]], [0.5 * math.sqrt(4) / 10]),
    ],
)
def test_propagated_std_by_hand(name: str, nodes: list[list[list[float]]], expected: list[float]) -> None:
    kernel = kernel_of(name)
    std = propagated_std(kernel.control_error, [torch.tensor(rows) for rows in nodes])
    assert std[0].tolist() == pytest.approx(expected, rel=1e-5)


@several_examples
@given(seed=seeds)
def test_propagated_std_of_l2l_agrees_with_simulated_noise(seed: int) -> None:
    kernel, generator = kernel_of("l2l"), torch.Generator().manual_seed(seed)
    nodes = [torch.tensor([[0.0, 4.0, 60.0, 10.0]]), torch.tensor([[70.0, 0.0, 150.0, 3.0]])]
    noisy = [rows + 0.5 * torch.randn(4000, 4, generator=generator) for rows in nodes]
    simulated = kernel.control_error(noisy).std(dim=0)
    assert propagated_std(kernel.control_error, nodes)[0].tolist() == pytest.approx(simulated.tolist(), rel=0.1)


def test_propagated_std_without_instances_and_of_a_constant() -> None:
    kernel = kernel_of("p2p")
    assert propagated_std(kernel.control_error, [torch.zeros(0, 2), torch.zeros(0, 2)]).shape == (0, 2)
    assert propagated_std(lambda nodes: torch.ones(3, 1), [torch.zeros(3, 2)]).tolist() == [[0.0]] * 3


@pytest.mark.parametrize("name", KERNEL_NAMES)
def test_no_sign_flips_in_ten_thousand_frames(name: str) -> None:
    """100 approaches of 100 frames: the camera turns, lines are split anew and ends exchanged in every frame."""
    kernel, random, flips = kernel_of(name), np.random.default_rng(0), 0
    count, reference = 100, reference_line(kernel)
    axis_angle = random.uniform(-np.pi, np.pi, count)
    axis = torch.from_numpy(unit(axis_angle))
    tilt = axis_angle + random.uniform(-1.2, 1.2, count)  # of the resting lines, to which the axis is fitted
    turn, lean = random.uniform(-2 * np.pi, 2 * np.pi, count), random.uniform(-1.2, 1.2, count)
    start, last, before = random.uniform(-150, 150, (count, 2)), None, None
    for share in np.linspace(0, 1, 100):
        nodes = []
        for role, place, angle in zip(kernel.roles, ((1 - share) * start, 0 * start), (lean, 0 * lean), strict=True):
            way = unit(tilt + (1 - share) * angle)
            ends = [place] if role is POINT else [place - random.uniform(30, 50, (count, 1)) * way, place + 40 * way]
            seen = np.stack(ends, axis=1) @ np.stack([unit(turn * share), unit(turn * share + np.pi / 2)], axis=1)
            exchanged = random.random(count) < 0.5
            seen[exchanged] = seen[exchanged, ::-1]
            seen += random.normal(0, 0.5, seen.shape)
            nodes.append(torch.from_numpy(seen.reshape(count, -1)))
        if reference is not None and before is not None:
            axis = turned(axis, before[reference], nodes[reference])
        before = directed_nodes(kernel, nodes, axis)
        error, std = kernel.control_error(before), propagated_std(kernel.control_error, before)
        if last is not None:
            large = (error.abs() > 5 * std) & (last[0].abs() > 5 * last[1])
            flips += int((large & (error * last[0] < 0)).sum())
        last = error, std
    assert flips == 0


def unit(angle: np.ndarray) -> np.ndarray:
    return np.stack([np.cos(angle), np.sin(angle)], axis=-1)


@pytest.mark.parametrize("name", KERNEL_NAMES)
def test_every_row_has_a_name(name: str) -> None:
    kernel = kernel_of(name)
    assert len(error_row_names(kernel)) == kernel.error_dim == len(set(error_row_names(kernel)))
    reference = reference_line(kernel)
    assert (reference is None) == (LINE not in kernel.roles)
    assert reference is None or all(order[reference] is not None for order in automorphisms(kernel))
