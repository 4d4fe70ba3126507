"""One member of a skill: precision, errors of its instances, select-out, and what a checkpoint keeps."""

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
    motif = Motif.of(kernel, {kind: DIMS[kind] for kind in types})
    network = (
        Bilinear(motif, hidden_dim=16)
        if scorer == "bilinear"
        else MessagePassing(motif, hidden_dim=16, layers=3, shared_weights=True, read_out="perceptron")
    )
    return KernelModel(kernel, {kind: EXTRACTORS[kind] for kind in types}, network)


def frame_of(kernel: Kernel, counts: dict[NodeType, int], seed: int = 0) -> MotifGraph:
    random = np.random.default_rng(seed)
    features, motion = {}, {}
    for kind, count in counts.items():
        descriptors = random.normal(size=(count, DIMS[kind])).astype(np.float32)
        geometry = random.uniform(0, 200, (count, kind.geometry_dim)).astype(np.float32)
        features[kind] = FeatureSet(
            kind,
            descriptors / np.linalg.norm(descriptors, axis=1, keepdims=True),
            geometry,
            np.zeros(count, np.float32),
        )
        motion[kind] = Displacement(torch.from_numpy(geometry + 3), torch.ones(count, dtype=torch.bool))
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
    # bfloat16 has 8 bits: some rounding, or the precision inside was not low at all, and no more.
    assert 0 < (scores - exact).abs().max() < 0.05


def test_training_under_autocast_gives_float32_gradients() -> None:
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


def test_other_descriptors_take_the_place_of_the_graphs_own() -> None:
    model = model_of(PointToPoint())
    one, other = (frame_of(PointToPoint(), {POINT: 5}, seed=seed) for seed in (0, 1))
    given = model(one, {POINT: other.point_descriptor})
    torch.testing.assert_close(given, model(other))
    assert (given - model(one)).abs().max() > 1e-5


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
def test_it_names_its_extractors_in_the_order_of_the_roles(
    kernel: Kernel, types: tuple[NodeType, ...], descriptor: str
) -> None:
    model = model_of(kernel)
    assert model.node_types == types
    assert model.descriptor == descriptor
    given = {kind: EXTRACTORS[kind] for kind in reversed(types)}
    assert KernelModel(kernel, given, model.scorer).descriptor == descriptor


@pytest.mark.parametrize("extractors", [{}, {POINT: "sift"}, {LINE: "lbd"}])
def test_a_type_without_an_extractor_is_refused(extractors: dict[NodeType, str]) -> None:
    with pytest.raises(ValueError, match=r"p2l has extractors for .*; expected .*point"):
        KernelModel(PointToLine(), extractors, model_of(PointToLine()).scorer)


def test_the_state_dict_keeps_beta_and_every_score(tmp_path: Path) -> None:
    model = model_of(PointToPoint())
    assert model.beta.shape == model.spans.shape == (0,)
    model.set_reward_scale(torch.tensor([1, 2, 4]), torch.tensor([0.5, 0.25, 0.125]))
    torch.save(model.state_dict(), tmp_path / "weights.pt")

    other = model_of(PointToPoint())
    with torch.no_grad():
        for parameter in other.parameters():
            parameter.add_(torch.randn_like(parameter))
    graph = frame_of(PointToPoint(), {POINT: 5})
    assert not torch.allclose(other(graph), model(graph))

    other.load_state_dict(torch.load(tmp_path / "weights.pt", weights_only=True))
    assert other.beta.tolist() == [0.5, 0.25, 0.125]
    assert other.spans.tolist() == [1, 2, 4]
    assert torch.equal(other(graph), model(graph))
    other.load_state_dict(model_of(PointToPoint()).state_dict())  # one that was never trained
    assert other.beta.shape == other.spans.shape == (0,)


def test_a_checkpoint_without_beta_is_refused() -> None:
    state = model_of(PointToPoint()).state_dict()
    del state["beta"]
    with pytest.raises(RuntimeError, match=r"Missing key.*beta"):
        model_of(PointToPoint()).load_state_dict(state)


def test_beta_moves_with_the_model() -> None:
    model = model_of(PointToPoint())
    model.set_reward_scale(torch.tensor([2]), torch.tensor([0.5]))
    assert model.to("meta").beta.is_meta


def test_as_many_betas_as_spans_are_expected() -> None:
    with pytest.raises(ValueError, match="2 values of beta for 1 spans"):
        model_of(PointToPoint()).set_reward_scale(torch.tensor([1]), torch.tensor([0.5, 0.25]))
