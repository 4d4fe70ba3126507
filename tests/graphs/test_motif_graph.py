"""A batch of frames is the frames: offsets, membership, the way back, and scores."""

from collections.abc import Mapping

import numpy as np
import pytest
import torch
from torch_geometric.data import Batch
from torch_geometric.loader import DataLoader

from geoskill.features.feature_set import FeatureSet
from geoskill.geometry.primitives import NodeType
from geoskill.graphs.motif_graph import (
    Displacement,
    MotifGraph,
    feature_graph,
    gather_nodes,
    motif_graph,
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

POINT, LINE = NodeType.POINT, NodeType.LINE
DIMS = {POINT: 6, LINE: 9}
# Points and lines of each frame: none, one, several, in every mixture, also at both ends.
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
        found = frame_features(points, lines, seed)
        graphs.append(motif_graph(kernel, found, motions(found, seed) if with_motion else None))
    return graphs


def motions(found: Mapping[NodeType, FeatureSet], seed: int) -> dict[NodeType, Displacement]:
    generator = torch.Generator().manual_seed(seed)
    return {
        kind: Displacement(
            torch.rand(features.geometry.shape, generator=generator),
            torch.rand(len(features), generator=generator) < 0.5,
        )
        for kind, features in found.items()
    }


def test_a_frame_holds_its_features_and_all_instances() -> None:
    found = frame_features(2, 3, seed=0)
    graph = motif_graph(PointToLine(), found)
    for kind in (POINT, LINE):
        np.testing.assert_array_equal(graph[f"{kind}_descriptor"].numpy(), found[kind].descriptors)
        np.testing.assert_array_equal(graph[f"{kind}_geometry"].numpy(), found[kind].geometry)
        assert f"{kind}_next_geometry" not in graph
    assert graph.instance_index.tolist() == [[0, 0, 0, 1, 1, 1], [0, 1, 2, 0, 1, 2]]
    assert graph.instance_frame.tolist() == [0] * 6
    assert graph.num_nodes == 5
    assert (graph.node_count(POINT), graph.node_count(LINE)) == (2, 3)
    assert graph.roles == ("point", "line")


def test_features_of_other_types_are_left_out() -> None:
    graph = motif_graph(PointToPoint(), frame_features(3, 4, seed=0))
    assert not [key for key in graph.keys() if key.startswith("line")]  # noqa: SIM118  (iterating a Data gives pairs)
    assert graph.num_nodes == 3


def test_motion_is_kept_by_type() -> None:
    found = frame_features(2, 3, seed=0)
    motion = motions(found, seed=1)
    graph = motif_graph(PointToLine(), found, motion)
    for kind in (POINT, LINE):
        assert torch.equal(graph[f"{kind}_next_geometry"], motion[kind].next_geometry)
        assert torch.equal(graph[f"{kind}_tracked"], motion[kind].tracked)


def test_offsets_in_a_batch_written_out_for_one_type() -> None:
    counts = [2, 0, 1, 3]
    batch = Batch.from_data_list([motif_graph(PointToPoint(), frame_features(n, 0, seed=n)) for n in counts])
    assert batch.instance_index.tolist() == [[0, 3, 3, 4], [1, 4, 5, 5]]
    assert batch.instance_frame.tolist() == [0, 3, 3, 3]
    assert batch.num_graphs == 4
    assert batch.num_nodes == 6


def test_each_row_has_the_offset_of_its_own_type() -> None:
    counts = [(1, 2), (0, 2), (2, 0), (2, 1)]
    batch = Batch.from_data_list([motif_graph(PointToLine(), frame_features(p, n, seed=p)) for p, n in counts])
    assert batch.instance_index.tolist() == [[0, 0, 3, 4], [0, 1, 4, 4]]
    assert batch.instance_frame.tolist() == [0, 0, 3, 3]


@pytest.mark.parametrize("kernel", [PointToPoint(), PointToLine(), LineToLine()], ids=lambda kernel: kernel.name)
def test_instances_of_a_batch_join_the_features_of_their_own_frame(kernel: Kernel) -> None:
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
def test_instances_of_visible_features(kernel: Kernel, share: float) -> None:
    """Those of all features without any that has a hidden one, in the same order; of a batch those of its frames."""
    complete = Batch.from_data_list(frames(kernel))
    without = Batch.from_data_list(
        [feature_graph(kernel, frame_features(points, lines, seed)) for seed, (points, lines) in enumerate(COUNTS)]
    )
    assert "instance_index" not in without
    generator = torch.Generator().manual_seed(0)
    visible = {kind: torch.rand(without.node_count(kind), generator=generator) >= share for kind in node_types(kernel)}
    found = with_instances(kernel, without, visible)
    assert "instance_index" not in without
    of_roles = zip(kernel.roles, complete.instance_index, strict=True)
    kept = torch.stack([visible[role][row] for role, row in of_roles]).all(dim=0)
    assert torch.equal(found.instance_index, complete.instance_index[:, kept])
    assert torch.equal(found.instance_frame, complete.instance_frame[kept])
    assert found.num_graphs == len(COUNTS)
    assert torch.equal(found[f"{kernel.roles[0]}_geometry"], complete[f"{kernel.roles[0]}_geometry"])
    everything = with_instances(kernel, without)
    assert torch.equal(everything.instance_index, complete.instance_index)


def _by_type(kernel: Kernel, graph: MotifGraph, attribute: str) -> dict[NodeType, torch.Tensor]:
    return {kind: graph[f"{kind}_{attribute}"] for kind in node_types(kernel)}


@pytest.mark.parametrize("kernel", [PointToPoint(), PointToLine(), LineToLine()], ids=lambda kernel: kernel.name)
def test_a_batch_gives_its_frames_back(kernel: Kernel) -> None:
    graphs = frames(kernel, with_motion=True)
    batch = Batch.from_data_list(graphs)
    for back, graph in [
        *zip(batch.to_data_list(), graphs, strict=True),
        *((batch.get_example(t), graphs[t]) for t in range(len(graphs))),
    ]:
        assert type(back) is MotifGraph
        assert set(back.keys()) == set(graph.keys())
        for key, value in graph.to_dict().items():
            if isinstance(value, torch.Tensor):
                assert torch.equal(back[key], value), key
                assert back[key].dtype == value.dtype, key
            else:
                assert back[key] == value, key


def test_the_way_back_leads_again_to_the_batch() -> None:
    graphs = frames(PointToLine(), with_motion=True)
    batch = Batch.from_data_list(graphs)
    again = Batch.from_data_list(batch.to_data_list())
    assert torch.equal(again.instance_index, batch.instance_index)
    assert torch.equal(again.instance_frame, batch.instance_frame)


def test_the_data_loader_of_pytorch_geometric_batches_a_list() -> None:
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


def test_the_data_loader_batches_transitions_of_several_members() -> None:
    """The form that training uses: a dictionary of graphs for each transition."""
    points, mixed = frames(PointToPoint()), frames(PointToLine())
    items = [{"p2p": {"first": a}, "p2l": {"first": b}} for a, b in zip(points, mixed, strict=True)]
    (batch,) = DataLoader(items, batch_size=len(items))
    assert torch.equal(batch["p2p"]["first"].instance_index, Batch.from_data_list(points).instance_index)
    assert torch.equal(batch["p2l"]["first"].instance_index, Batch.from_data_list(mixed).instance_index)


def _model(kernel: Kernel, scorer: str) -> KernelModel:
    torch.manual_seed(0)
    motif = Motif.of(kernel, {kind: DIMS[kind] for kind in node_types(kernel)})
    network: InstanceScorer = (
        MessagePassing(motif, hidden_dim=16, layers=3, shared_weights=True, read_out="perceptron")
        if scorer == "message passing"
        else Bilinear(motif, hidden_dim=16)
    )
    return KernelModel(kernel, dict.fromkeys(node_types(kernel), "any"), network)


@pytest.mark.parametrize("scorer", ["message passing", "bilinear"])
@pytest.mark.parametrize("kernel", [PointToPoint(), PointToLine(), LineToLine()], ids=lambda kernel: kernel.name)
def test_scores_and_errors_of_a_batch_are_those_of_its_frames(kernel: Kernel, scorer: str) -> None:
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


def test_a_batch_moves_to_another_device_as_a_whole() -> None:
    batch = Batch.from_data_list(frames(PointToLine(), with_motion=True)).to("meta")
    tensors = [value for value in batch.to_dict().values() if isinstance(value, torch.Tensor)]
    assert len(tensors) >= 10
    assert all(value.is_meta for value in tensors)
