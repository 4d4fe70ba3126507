"""Frames as graphs, alone and in a batch: offsets, membership, unbatching, and scores."""

import copy
from collections.abc import Mapping

import numpy as np
import pytest
import torch
from torch_geometric.data import Batch
from torch_geometric.loader import DataLoader

from geoskill.features.feature_set import FeatureSet
from geoskill.geometry.primitives import NodeType
from geoskill.graphs.motif_graph import (
    MotifGraph,
    gather_nodes,
    motif_graph,
    take_features,
    with_instances,
)
from geoskill.kernels.kernel import Kernel, node_types
from geoskill.kernels.l2l import LineToLine
from geoskill.kernels.p2l import PointToLine
from geoskill.kernels.p2p import PointToPoint
from geoskill.model.bilinear import Bilinear
from geoskill.model.kernel_model import KernelModel
from geoskill.model.message_passing import MessagePassing
from geoskill.model.scorer import InstanceScorer, Motif
from geoskill.tracking.motion import Displacement, Trajectory

POINT, LINE = NodeType.POINT, NodeType.LINE
DIMS = {POINT: 6, LINE: 9}
# Points and lines per frame: none, one and several in all combinations, with empty frames at both ends.
COUNTS = [(0, 0), (3, 2), (1, 4), (0, 3), (4, 0), (1, 1), (2, 5), (0, 0)]


def feature_set(node_type: NodeType, count: int, seed: int) -> FeatureSet:
    random = np.random.default_rng([seed, count])
    descriptors = random.normal(size=(count, DIMS[node_type])).astype(np.float32)
    return FeatureSet(
        node_type,
        descriptors / np.linalg.norm(descriptors, axis=1, keepdims=True),
        random.uniform(0, 200, (count, node_type.geometry_dim)).astype(np.float32),
        np.arange(count, 0, -1, dtype=np.float32),
    )


def frame_features(points: int, lines: int, seed: int) -> dict[NodeType, FeatureSet]:
    return {POINT: feature_set(POINT, points, seed), LINE: feature_set(LINE, lines, seed)}


def frames(kernel: Kernel, with_motion: bool = False) -> list[MotifGraph]:
    graphs = []
    for seed, (points, lines) in enumerate(COUNTS):
        features = frame_features(points, lines, seed)
        records = (motions(features, seed), paths(features, seed)) if with_motion else ()
        graphs.append(motif_graph(kernel, features, *records))
    return graphs


def motions(feature_sets: Mapping[NodeType, FeatureSet], seed: int) -> dict[NodeType, Displacement]:
    generator = torch.Generator().manual_seed(seed)
    return {
        node_type: Displacement(
            torch.rand(features.geometry.shape, generator=generator),
            torch.rand(len(features), generator=generator) < 0.5,
        )
        for node_type, features in feature_sets.items()
    }


def paths(feature_sets: Mapping[NodeType, FeatureSet], seed: int) -> dict[NodeType, Trajectory]:
    generator = torch.Generator().manual_seed(seed)
    return {
        node_type: Trajectory(
            torch.rand((len(features), 3, node_type.geometry_dim), generator=generator),
            torch.randint(4, (len(features),), generator=generator),
            torch.rand(features.geometry.shape, generator=generator),
            torch.rand(len(features), generator=generator) < 0.5,
            torch.randint(4, (len(features),), generator=generator),
        )
        for node_type, features in feature_sets.items()
    }


def test_motif_graph_holds_features_and_all_instances() -> None:
    features = frame_features(2, 3, seed=0)
    graph = motif_graph(PointToLine(), features)
    for node_type in (POINT, LINE):
        np.testing.assert_array_equal(graph[f"{node_type}_descriptor"].numpy(), features[node_type].descriptors)
        np.testing.assert_array_equal(graph[f"{node_type}_geometry"].numpy(), features[node_type].geometry)
        assert f"{node_type}_next_geometry" not in graph
    assert graph.instance_index.tolist() == [[0, 0, 0, 1, 1, 1], [0, 1, 2, 0, 1, 2]]
    assert graph.instance_frame.tolist() == [0] * 6
    assert graph.num_nodes == 5
    assert (graph.node_count(POINT), graph.node_count(LINE)) == (2, 3)
    assert graph.roles == ("point", "line")


def test_motif_graph_omits_other_node_types() -> None:
    graph = motif_graph(PointToPoint(), frame_features(3, 4, seed=0))
    assert not [key for key in graph.keys() if key.startswith("line")]  # noqa: SIM118  (iterating a Data gives pairs)
    assert graph.num_nodes == 3


def test_motif_graph_holds_displacements() -> None:
    features = frame_features(2, 3, seed=0)
    motion = motions(features, seed=1)
    graph = motif_graph(PointToLine(), features, motion)
    for node_type in (POINT, LINE):
        assert torch.equal(graph[f"{node_type}_next_geometry"], motion[node_type].next_geometry)
        assert torch.equal(graph[f"{node_type}_tracked"], motion[node_type].tracked)


def test_batch_offsets_of_one_type_by_hand() -> None:
    counts = [2, 0, 1, 3]
    batch = Batch.from_data_list([motif_graph(PointToPoint(), frame_features(n, 0, seed=n)) for n in counts])
    assert batch.instance_index.tolist() == [[0, 3, 3, 4], [1, 4, 5, 5]]
    assert batch.instance_frame.tolist() == [0, 3, 3, 3]
    assert batch.num_graphs == 4
    assert batch.num_nodes == 6


def test_batch_offsets_of_two_types_by_hand() -> None:
    counts = [(1, 2), (0, 2), (2, 0), (2, 1)]
    batch = Batch.from_data_list([motif_graph(PointToLine(), frame_features(p, n, seed=p)) for p, n in counts])
    assert batch.instance_index.tolist() == [[0, 0, 3, 4], [0, 1, 4, 4]]
    assert batch.instance_frame.tolist() == [0, 0, 3, 3]


@pytest.mark.parametrize("kernel", [PointToPoint(), PointToLine(), LineToLine()], ids=lambda kernel: kernel.name)
def test_batch_instances_join_features_of_their_frame(kernel: Kernel) -> None:
    graphs = frames(kernel)
    batch = Batch.from_data_list(graphs)
    for attribute in ("descriptor", "geometry"):
        together = gather_nodes(kernel, _by_type(kernel, batch, attribute), batch.instance_index)
        one_by_one = [gather_nodes(kernel, _by_type(kernel, g, attribute), g.instance_index) for g in graphs]
        for role in range(len(kernel.roles)):
            assert torch.equal(together[role], torch.cat([nodes[role] for nodes in one_by_one]))
    counts = [graph.instance_index.shape[1] for graph in graphs]
    assert torch.equal(batch.instance_frame, torch.repeat_interleave(torch.arange(len(graphs)), torch.tensor(counts)))


@pytest.mark.parametrize("kernel", [PointToPoint(), PointToLine(), LineToLine()])
@pytest.mark.parametrize("share", [0.0, 0.4, 1.0])
def test_taken_features_have_the_instances_that_join_them(kernel: Kernel, share: float) -> None:
    """All instances without those that have a hidden feature, in the same order, in every frame of a batch."""
    complete = Batch.from_data_list(frames(kernel, with_motion=True))
    without = copy.copy(complete)
    del without.instance_index, without.instance_frame
    generator = torch.Generator().manual_seed(0)
    chosen = {
        node_type: torch.rand(without.node_count(node_type), generator=generator) >= share
        for node_type in node_types(kernel)
    }
    graph = with_instances(kernel, take_features(without, chosen))
    assert "instance_index" not in without
    rows_by_role = zip(kernel.roles, complete.instance_index, strict=True)
    kept = torch.stack([chosen[role][row] for role, row in rows_by_role]).all(dim=0)
    assert torch.equal(graph.instance_frame, complete.instance_frame[kept])
    assert graph.num_graphs == len(COUNTS)
    assert graph.num_nodes == sum(int(mask.sum()) for mask in chosen.values())
    assert set(graph.keys()) == set(complete.keys()) - {"batch", "ptr"}, "which would be those of all features"
    attributes = {key.partition("_")[2] for key in complete.keys() if key.startswith(f"{kernel.roles[0]}_")}  # noqa: SIM118
    assert len(attributes) == 10
    for name in attributes - {"count"}:
        for role, row, kept_row in zip(
            kernel.roles, graph.instance_index, complete.instance_index[:, kept], strict=True
        ):
            assert torch.equal(graph[f"{role}_{name}"][row], complete[f"{role}_{name}"][kept_row]), name
    for node_type, mask in chosen.items():
        per_frame = [int(own.sum()) for own in mask.split(complete[f"{node_type}_count"].tolist())]
        assert graph[f"{node_type}_count"].tolist() == per_frame
    assert torch.equal(with_instances(kernel, without).instance_index, complete.instance_index)


def _by_type(kernel: Kernel, graph: MotifGraph, attribute: str) -> dict[NodeType, torch.Tensor]:
    return {node_type: graph[f"{node_type}_{attribute}"] for node_type in node_types(kernel)}


@pytest.mark.parametrize("kernel", [PointToPoint(), PointToLine(), LineToLine()], ids=lambda kernel: kernel.name)
def test_batch_to_data_list_round_trip(kernel: Kernel) -> None:
    graphs = frames(kernel, with_motion=True)
    batch = Batch.from_data_list(graphs)
    for unbatched, graph in [
        *zip(batch.to_data_list(), graphs, strict=True),
        *((batch.get_example(t), graphs[t]) for t in range(len(graphs))),
    ]:
        assert type(unbatched) is MotifGraph
        assert set(unbatched.keys()) == set(graph.keys())
        for key, value in graph.to_dict().items():
            if isinstance(value, torch.Tensor):
                assert torch.equal(unbatched[key], value), key
                assert unbatched[key].dtype == value.dtype, key
            else:
                assert unbatched[key] == value, key


def test_batch_of_unbatched_frames_equals_batch() -> None:
    graphs = frames(PointToLine(), with_motion=True)
    batch = Batch.from_data_list(graphs)
    second_batch = Batch.from_data_list(batch.to_data_list())
    assert torch.equal(second_batch.instance_index, batch.instance_index)
    assert torch.equal(second_batch.instance_frame, batch.instance_frame)


def test_data_loader_batches_graphs() -> None:
    graphs = frames(PointToLine(), with_motion=True)
    batches = list(DataLoader(graphs, batch_size=3))
    assert [batch.num_graphs for batch in batches] == [3, 3, 2]
    for batch, start in zip(batches, (0, 3, 6), strict=True):
        expected = Batch.from_data_list(graphs[start : start + 3])
        for key in (
            "instance_index",
            "instance_frame",
            "point_descriptor",
            "line_next_geometry",
            "line_tracked",
            "batch",
        ):
            assert torch.equal(batch[key], expected[key]), key


def test_data_loader_batches_transitions_of_several_members() -> None:
    """Training uses a dictionary of graphs per transition."""
    points, mixed = frames(PointToPoint()), frames(PointToLine())
    items = [{"p2p": {"first": a}, "p2l": {"first": b}} for a, b in zip(points, mixed, strict=True)]
    (batch,) = DataLoader(items, batch_size=len(items))
    assert torch.equal(batch["p2p"]["first"].instance_index, Batch.from_data_list(points).instance_index)
    assert torch.equal(batch["p2l"]["first"].instance_index, Batch.from_data_list(mixed).instance_index)


def _model(kernel: Kernel, scorer: str) -> KernelModel:
    torch.manual_seed(0)
    motif = Motif.of(kernel, {node_type: DIMS[node_type] for node_type in node_types(kernel)})
    network: InstanceScorer = (
        MessagePassing(motif, hidden_dim=16, layers=3, shared_weights=True, read_out="perceptron")
        if scorer == "message passing"
        else Bilinear(motif, hidden_dim=16)
    )
    return KernelModel(kernel, dict.fromkeys(node_types(kernel), "any"), network)


@pytest.mark.parametrize("scorer", ["message passing", "bilinear"])
@pytest.mark.parametrize("kernel", [PointToPoint(), PointToLine(), LineToLine()], ids=lambda kernel: kernel.name)
def test_batch_scores_and_errors_equal_those_of_frames(kernel: Kernel, scorer: str) -> None:
    model = _model(kernel, scorer)
    graphs = frames(kernel, with_motion=True)
    batch = Batch.from_data_list(graphs)
    scores = torch.cat([model(graph) for graph in graphs])
    assert len(scores) == batch.instance_index.shape[1] > 0
    torch.testing.assert_close(model(batch), scores, rtol=1e-5, atol=1e-6)
    for geometry in ("geometry", "next_geometry"):
        errors = torch.cat([model.control_errors(graph, geometry) for graph in graphs])
        assert errors.shape == (len(scores), kernel.error_dim)
        assert torch.equal(model.control_errors(batch, geometry), errors)


def test_batch_moves_to_another_device() -> None:
    batch = Batch.from_data_list(frames(PointToLine(), with_motion=True)).to("meta")
    tensors = [value for value in batch.to_dict().values() if isinstance(value, torch.Tensor)]
    assert len(tensors) >= 10
    assert all(value.is_meta for value in tensors)
