"""The dense message passing against PyTorch Geometric's, motif by motif."""

from itertools import combinations, permutations

import pytest
import torch
from torch import Tensor
from torch.nn.functional import normalize

from geoskill.geometry.primitives import NodeType
from geoskill.kernels.kernel import Kernel
from geoskill.kernels.l2l import LineToLine
from geoskill.kernels.p2l import PointToLine
from geoskill.kernels.p2p import PointToPoint
from geoskill.model.message_passing import MessagePassing
from geoskill.model.read_out import PerceptronReadOut
from geoskill.model.reference import reference_scores
from geoskill.model.scorer import Motif

POINT, LINE = NodeType.POINT, NodeType.LINE
DIMS = {POINT: 6, LINE: 9}


def motif_of(kernel: type[Kernel]) -> Motif:
    return Motif.of(kernel(), {role: DIMS[role] for role in kernel.roles})


def both_ways(*edges: tuple[int, int]) -> tuple[tuple[int, int], ...]:
    return (*edges, *((j, i) for i, j in edges))


MOTIFS = {
    "p2p": motif_of(PointToPoint),
    "l2l": motif_of(LineToLine),
    "p2l": motif_of(PointToLine),
    "four points, complete": Motif(
        (POINT,) * 4,
        both_ways(*combinations(range(4), 2)),
        tuple(permutations(range(4))),
        {POINT: 6},
    ),
    "path": Motif((POINT,) * 3, both_ways((0, 1), (1, 2)), ((0, 1, 2), (2, 1, 0)), {POINT: 6}),
    "path of two types": Motif(
        (POINT, LINE, POINT), both_ways((0, 1), (1, 2)), ((0, 1, 2), (2, 1, 0)), {POINT: 6, LINE: 9}
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
    """A scorer, descriptors that want gradients, and seven instances that share features."""
    torch.manual_seed(0)
    scorer = MessagePassing(
        motif, hidden_dim=8, layers=layers, shared_weights=shared, read_out=read_out, prototypes=prototypes
    ).to(dtype)
    scorer.fit_prototypes(
        {kind: normalize(torch.randn(9, dim, dtype=dtype)) for kind, dim in motif.descriptor_dims.items()}
    )
    descriptors = {
        kind: normalize(torch.randn(5, dim, dtype=dtype)).requires_grad_()
        for kind, dim in motif.descriptor_dims.items()
    }
    return scorer, descriptors, torch.randint(5, (len(motif.roles), 7))


@pytest.mark.parametrize("name", MOTIFS)
@pytest.mark.parametrize("shared", [True, False])
@pytest.mark.parametrize(
    ("layers", "read_out", "prototypes"), [(1, "perceptron", None), (3, "product", 7), (5, "perceptron", None)]
)
def test_values_and_gradients_equal_the_reference_in_float64(
    name: str, layers: int, read_out: str, prototypes: int | None, shared: bool
) -> None:
    scorer, descriptors, index = random_case(MOTIFS[name], torch.float64, layers, shared, read_out, prototypes)
    wanted = [*scorer.parameters(), *descriptors.values()]
    weights = torch.randn(7, dtype=torch.float64)
    dense, reference = scorer(descriptors, index), reference_scores(scorer, descriptors, index)
    assert dense.shape == (7,)
    assert dense.std() > 1e-5  # or equality would say nothing
    torch.testing.assert_close(dense, reference, rtol=0, atol=1e-10)
    gradients = torch.autograd.grad(dense @ weights, wanted)
    for ours, theirs in zip(gradients, torch.autograd.grad(reference @ weights, wanted), strict=True):
        assert theirs.abs().max() > 0
        torch.testing.assert_close(ours, theirs, rtol=0, atol=1e-10)


@pytest.mark.parametrize("name", MOTIFS)
def test_values_and_gradients_equal_the_reference_in_float32(name: str) -> None:
    scorer, descriptors, index = random_case(MOTIFS[name], torch.float32, layers=5, shared=True)
    wanted = [*scorer.parameters(), *descriptors.values()]
    dense, reference = scorer(descriptors, index), reference_scores(scorer, descriptors, index)
    torch.testing.assert_close(dense, reference, rtol=0, atol=1e-5)
    gradients = torch.autograd.grad(dense.sum(), wanted)
    for ours, theirs in zip(gradients, torch.autograd.grad(reference.sum(), wanted), strict=True):
        torch.testing.assert_close(ours, theirs, rtol=1e-5, atol=1e-5)


def test_one_message_and_one_update_written_out() -> None:
    """Without PyTorch Geometric and without any layer's code: p2l, T = 1, from the equations and the GRU's."""
    scorer, descriptors, index = random_case(MOTIFS["p2l"], torch.float64, layers=1, shared=True)
    weights = scorer.layer(0)
    h = 8

    def encoded(kind: NodeType, feature: Tensor) -> Tensor:
        layer = scorer.encoder.layers[str(kind)]
        return layer.weight @ (descriptors[kind][feature] * DIMS[kind] ** 0.5) + layer.bias

    def next_state(own: Tensor, other: Tensor) -> Tensor:
        inner = torch.relu(weights.source.weight @ other + weights.source.bias + weights.destination.weight @ own)
        message = weights.output.weight @ inner + weights.output.bias
        cell = weights.update
        given = cell.weight_ih @ message + cell.bias_ih
        kept = cell.weight_hh @ own + cell.bias_hh
        reset = torch.sigmoid(given[:h] + kept[:h])
        update = torch.sigmoid(given[h : 2 * h] + kept[h : 2 * h])
        candidate = torch.tanh(given[2 * h :] + reset * kept[2 * h :])
        return (1 - update) * candidate + update * own

    read_out = scorer.read_out
    assert isinstance(read_out, PerceptronReadOut)
    expected = []
    for instance in index.T:
        point, line = encoded(POINT, instance[0]), encoded(LINE, instance[1])
        expected.append(read_out.network(torch.cat([next_state(point, line), next_state(line, point)])))
    torch.testing.assert_close(scorer(descriptors, index), torch.cat(expected), rtol=0, atol=1e-12)


def test_no_instance_gives_no_score() -> None:
    scorer, descriptors, _ = random_case(MOTIFS["p2p"], torch.float32, layers=2, shared=True)
    index = torch.zeros(2, 0, dtype=torch.long)
    assert reference_scores(scorer, descriptors, index).shape == (0,)
    assert scorer(descriptors, index).shape == (0,)
