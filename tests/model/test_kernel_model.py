"""A member of a skill: precision, control errors, select-out, and the content of its state dict."""

from pathlib import Path

import numpy as np
import pytest
import torch
from torch_geometric.data import Batch

from geoskill.features.feature_set import FeatureSet
from geoskill.geometry.primitives import NodeType
from geoskill.graphs.motif_graph import MotifGraph, motif_graph
from geoskill.kernels.kernel import Kernel, node_types
from geoskill.kernels.l2l import LineToLine
from geoskill.kernels.p2l import PointToLine
from geoskill.kernels.p2p import PointToPoint
from geoskill.model.bilinear import Bilinear
from geoskill.model.kernel_model import KernelModel
from geoskill.model.message_passing import MessagePassing
from geoskill.model.scorer import Motif
from geoskill.objective.selection import select_out
from geoskill.tracking.motion import Displacement

POINT, LINE = NodeType.POINT, NodeType.LINE
DIMS = {POINT: 6, LINE: 9}
EXTRACTORS = {POINT: "sift", LINE: "lbd"}


def model_of(kernel: Kernel, scorer: str = "message passing") -> KernelModel:
    torch.manual_seed(0)
    types = node_types(kernel)
    motif = Motif.of(kernel, {node_type: DIMS[node_type] for node_type in types})
    network = (
        Bilinear(motif, hidden_dim=16)
        if scorer == "bilinear"
        else MessagePassing(motif, hidden_dim=16, layers=3, shared_weights=True, read_out="perceptron")
    )
    return KernelModel(kernel, {node_type: EXTRACTORS[node_type] for node_type in types}, network)


def frame_of(kernel: Kernel, counts: dict[NodeType, int], seed: int = 0) -> MotifGraph:
    random = np.random.default_rng(seed)
    features, motion = {}, {}
    for node_type, count in counts.items():
        descriptors = random.normal(size=(count, DIMS[node_type])).astype(np.float32)
        geometry = random.uniform(0, 200, (count, node_type.geometry_dim)).astype(np.float32)
        features[node_type] = FeatureSet(
            node_type,
            descriptors / np.linalg.norm(descriptors, axis=1, keepdims=True),
            geometry,
            np.zeros(count, np.float32),
        )
        motion[node_type] = Displacement(torch.from_numpy(geometry + 3), torch.ones(count, dtype=torch.bool))
    return motif_graph(kernel, features, motion)


@pytest.mark.parametrize("scorer", ["message passing", "bilinear"])
@pytest.mark.parametrize("kernel", [PointToPoint(), PointToLine(), LineToLine()], ids=lambda kernel: kernel.name)
def test_scores_are_float32_under_bfloat16_autocast(kernel: Kernel, scorer: str) -> None:
    model = model_of(kernel, scorer)
    graph = frame_of(kernel, {POINT: 5, LINE: 4})
    exact = model(graph)
    with torch.autocast("cpu", torch.bfloat16):
        scores = model(graph)
    assert scores.dtype == exact.dtype == torch.float32
    # bfloat16 has 8 bits: scores are rounded (or the precision inside was not low), but not by more.
    assert 0 < (scores - exact).abs().max() < 0.05


def test_gradients_are_float32_under_autocast() -> None:
    model = model_of(PointToPoint())
    with torch.autocast("cpu", torch.bfloat16):
        scores = model(frame_of(PointToPoint(), {POINT: 6}))
    scores.square().sum().backward()
    for name, parameter in model.named_parameters():
        assert parameter.grad is not None, name
        assert parameter.grad.dtype == torch.float32
        assert torch.isfinite(parameter.grad).all(), name


@pytest.mark.parametrize("scorer", ["message passing", "bilinear"])
def test_select_out_sums_to_one_over_each_frame(scorer: str) -> None:
    kernel = PointToLine()
    model = model_of(kernel, scorer)
    counts = [(3, 2), (0, 4), (1, 1), (5, 5), (2, 0)]
    batch = Batch.from_data_list([frame_of(kernel, {POINT: p, LINE: n}, seed=p) for p, n in counts])
    selected = select_out(model(batch), batch.instance_frame, batch.num_graphs)
    sums = torch.zeros(5).index_add(0, batch.instance_frame, selected)
    torch.testing.assert_close(sums, torch.tensor([1.0, 0.0, 1.0, 1.0, 0.0]))
    assert (selected > 0).all()


def test_forward_with_given_descriptors() -> None:
    model = model_of(PointToPoint())
    graph, second_graph = (frame_of(PointToPoint(), {POINT: 5}, seed=seed) for seed in (0, 1))
    scores = model(graph, {POINT: second_graph.point_descriptor})
    torch.testing.assert_close(scores, model(second_graph))
    assert (scores - model(graph)).abs().max() > 1e-5


def test_control_errors_of_both_geometries() -> None:
    kernel = PointToPoint()
    graph = frame_of(kernel, {POINT: 3})
    xy = graph.point_geometry
    expected = torch.stack([xy[0] - xy[1], xy[0] - xy[2], xy[1] - xy[2]])
    assert torch.equal(model_of(kernel).control_errors(graph), expected)
    graph.point_next_geometry[0] += torch.tensor([10.0, 0.0])
    moved = model_of(kernel).control_errors(graph, "next_geometry") - expected
    torch.testing.assert_close(moved, torch.tensor([[10.0, 0], [10, 0], [0, 0]]), rtol=0, atol=1e-4)


@pytest.mark.parametrize(
    ("kernel", "types", "descriptor"),
    [(PointToPoint(), (POINT,), "sift"), (LineToLine(), (LINE,), "lbd"), (PointToLine(), (POINT, LINE), "sift+lbd")],
    ids=["p2p", "l2l", "p2l"],
)
def test_descriptor_lists_extractors_in_order_of_roles(
    kernel: Kernel, types: tuple[NodeType, ...], descriptor: str
) -> None:
    model = model_of(kernel)
    assert model.node_types == types
    assert model.descriptor == descriptor
    reversed_extractors = {node_type: EXTRACTORS[node_type] for node_type in reversed(types)}
    assert KernelModel(kernel, reversed_extractors, model.scorer).descriptor == descriptor


@pytest.mark.parametrize("extractors", [{}, {POINT: "sift"}, {LINE: "lbd"}])
def test_kernel_model_rejects_wrong_extractors(extractors: dict[NodeType, str]) -> None:
    with pytest.raises(ValueError, match=r"p2l has extractors for .*; expected .*point"):
        KernelModel(PointToLine(), extractors, model_of(PointToLine()).scorer)


def test_state_dict_round_trip(tmp_path: Path) -> None:
    model = model_of(PointToPoint())
    assert model.beta.shape == model.spans.shape == (0,)
    model.set_reward_scale(torch.tensor([1, 2, 4]), torch.tensor([0.5, 0.25, 0.125]))
    torch.save(model.state_dict(), tmp_path / "weights.pt")

    loaded = model_of(PointToPoint())
    with torch.no_grad():
        for parameter in loaded.parameters():
            parameter.add_(torch.randn_like(parameter))
    graph = frame_of(PointToPoint(), {POINT: 5})
    assert not torch.allclose(loaded(graph), model(graph))

    loaded.load_state_dict(torch.load(tmp_path / "weights.pt", weights_only=True))
    assert loaded.beta.tolist() == [0.5, 0.25, 0.125]
    assert loaded.spans.tolist() == [1, 2, 4]
    assert torch.equal(loaded(graph), model(graph))
    loaded.load_state_dict(model_of(PointToPoint()).state_dict())  # of an untrained model
    assert loaded.beta.shape == loaded.spans.shape == (0,)


def test_load_state_dict_rejects_missing_beta() -> None:
    state = model_of(PointToPoint()).state_dict()
    del state["beta"]
    with pytest.raises(RuntimeError, match=r"Missing key.*beta"):
        model_of(PointToPoint()).load_state_dict(state)


def test_beta_moves_with_the_model() -> None:
    model = model_of(PointToPoint())
    model.set_reward_scale(torch.tensor([2]), torch.tensor([0.5]))
    assert model.to("meta").beta.is_meta


def test_set_reward_scale_rejects_unequal_lengths() -> None:
    with pytest.raises(ValueError, match="2 values of beta for 1 spans"):
        model_of(PointToPoint()).set_reward_scale(torch.tensor([1]), torch.tensor([0.5, 0.25]))
