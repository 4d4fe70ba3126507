"""The dense message passing against the PyTorch Geometric reference, for every motif."""

from itertools import combinations, permutations

import pytest
import torch
from torch import Tensor
from torch.nn.functional import normalize

from geoskill.benchmarks.pyg_reference import PygNetwork, instance_batch, reference_scores
from geoskill.geometry.primitives import NodeType
from geoskill.kernels.kernel import Kernel
from geoskill.kernels.l2l import LineToLine
from geoskill.kernels.p2l import PointToLine
from geoskill.kernels.p2p import PointToPoint
from geoskill.model.message_passing import MessagePassing
from geoskill.model.read_out import PerceptronReadOut
from geoskill.model.scorer import Motif

POINT, LINE = NodeType.POINT, NodeType.LINE
DIMS = {POINT: 6, LINE: 9}


def motif_of(kernel: type[Kernel]) -> Motif:
    return Motif.of(kernel(), {role: DIMS[role] for role in kernel.roles})


def in_both_directions(*edges: tuple[int, int]) -> tuple[tuple[int, int], ...]:
    return (*edges, *((j, i) for i, j in edges))


MOTIFS = {
    "p2p": motif_of(PointToPoint),
    "l2l": motif_of(LineToLine),
    "p2l": motif_of(PointToLine),
    "four points, complete": Motif(
        (POINT,) * 4,
        in_both_directions(*combinations(range(4), 2)),
        tuple(permutations(range(4))),
        {POINT: 6},
    ),
    "path": Motif((POINT,) * 3, in_both_directions((0, 1), (1, 2)), ((0, 1, 2), (2, 1, 0)), {POINT: 6}),
    "path of two types": Motif(
        (POINT, LINE, POINT), in_both_directions((0, 1), (1, 2)), ((0, 1, 2), (2, 1, 0)), {POINT: 6, LINE: 9}
    ),
}


def random_case(
    motif: Motif,
    dtype: torch.dtype,
    layers: int,
    shared: bool,
    read_out: str = "perceptron",
    prototypes: int | None = None,
) -> tuple[MessagePassing, dict[NodeType, Tensor], Tensor]:
    """Build a scorer, descriptors that require gradients, and seven instances that share features."""
    torch.manual_seed(0)
    scorer = MessagePassing(
        motif, hidden_dim=8, layers=layers, shared_weights=shared, read_out=read_out, prototypes=prototypes
    ).to(dtype)
    scorer.fit_prototypes(
        {node_type: normalize(torch.randn(9, dim, dtype=dtype)) for node_type, dim in motif.descriptor_dims.items()}
    )
    descriptors = {
        node_type: normalize(torch.randn(5, dim, dtype=dtype)).requires_grad_()
        for node_type, dim in motif.descriptor_dims.items()
    }
    return scorer, descriptors, torch.randint(5, (len(motif.roles), 7))


@pytest.mark.slow
@pytest.mark.parametrize("name", MOTIFS)
@pytest.mark.parametrize("shared", [True, False])
@pytest.mark.parametrize(
    ("layers", "read_out", "prototypes"), [(1, "perceptron", None), (3, "product", 7), (5, "perceptron", None)]
)
def test_message_passing_equals_reference_in_float64(
    name: str, layers: int, read_out: str, prototypes: int | None, shared: bool
) -> None:
    scorer, descriptors, index = random_case(MOTIFS[name], torch.float64, layers, shared, read_out, prototypes)
    inputs = [*scorer.parameters(), *descriptors.values()]
    weights = torch.randn(7, dtype=torch.float64)
    dense, reference = scorer(descriptors, index), reference_scores(scorer, descriptors, index)
    assert dense.shape == (7,)
    assert dense.std() > 1e-5  # constant scores would be equal whatever the network does
    torch.testing.assert_close(dense, reference, rtol=0, atol=1e-10)
    batched = PygNetwork(scorer)(instance_batch(scorer.motif, descriptors, index))
    torch.testing.assert_close(batched, reference, rtol=0, atol=1e-10)
    gradients = torch.autograd.grad(dense @ weights, inputs)
    for gradient, expected in zip(gradients, torch.autograd.grad(reference @ weights, inputs), strict=True):
        assert expected.abs().max() > 0
        torch.testing.assert_close(gradient, expected, rtol=0, atol=1e-10)


@pytest.mark.parametrize("name", MOTIFS)
def test_message_passing_equals_reference_in_float32(name: str) -> None:
    scorer, descriptors, index = random_case(MOTIFS[name], torch.float32, layers=5, shared=True)
    inputs = [*scorer.parameters(), *descriptors.values()]
    dense, reference = scorer(descriptors, index), reference_scores(scorer, descriptors, index)
    torch.testing.assert_close(dense, reference, rtol=0, atol=1e-5)
    gradients = torch.autograd.grad(dense.sum(), inputs)
    for gradient, expected in zip(gradients, torch.autograd.grad(reference.sum(), inputs), strict=True):
        torch.testing.assert_close(gradient, expected, rtol=1e-5, atol=1e-5)


def test_message_passing_equals_the_equations() -> None:
    """One step on p2l from the paper's equations and the GRU's, without PyTorch Geometric or any layer's code."""
    scorer, descriptors, index = random_case(MOTIFS["p2l"], torch.float64, layers=1, shared=True)
    weights = scorer.layer(0)
    h = 8

    def encoded(node_type: NodeType, feature: Tensor) -> Tensor:
        layer = scorer.encoder.layers[str(node_type)]
        return layer.weight @ (descriptors[node_type][feature] * DIMS[node_type] ** 0.5) + layer.bias

    def next_state(own: Tensor, neighbor: Tensor) -> Tensor:
        inner = torch.relu(weights.source.weight @ neighbor + weights.source.bias + weights.destination.weight @ own)
        message = weights.output.weight @ inner + weights.output.bias
        cell = weights.update
        from_message = cell.weight_ih @ message + cell.bias_ih
        from_state = cell.weight_hh @ own + cell.bias_hh
        reset = torch.sigmoid(from_message[:h] + from_state[:h])
        update = torch.sigmoid(from_message[h : 2 * h] + from_state[h : 2 * h])
        candidate = torch.tanh(from_message[2 * h :] + reset * from_state[2 * h :])
        return (1 - update) * candidate + update * own

    read_out = scorer.read_out
    assert isinstance(read_out, PerceptronReadOut)
    expected = []
    for instance in index.T:
        point, line = encoded(POINT, instance[0]), encoded(LINE, instance[1])
        expected.append(read_out.network(torch.cat([next_state(point, line), next_state(line, point)])))
    torch.testing.assert_close(scorer(descriptors, index), torch.cat(expected), rtol=0, atol=1e-12)


def test_no_instances_give_no_scores() -> None:
    scorer, descriptors, _ = random_case(MOTIFS["p2p"], torch.float32, layers=2, shared=True)
    index = torch.zeros(2, 0, dtype=torch.long)
    assert reference_scores(scorer, descriptors, index).shape == (0,)
    assert scorer(descriptors, index).shape == (0,)
