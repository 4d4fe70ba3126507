"""The contract of every network that scores instances."""

import importlib
import inspect
from collections.abc import Callable
from pathlib import Path

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch import Tensor

import geoskill.model.scorer
from geoskill.geometry.primitives import NodeType
from geoskill.kernels.kernel import Kernel
from geoskill.kernels.l2l import LineToLine
from geoskill.kernels.p2l import PointToLine
from geoskill.kernels.p2p import PointToPoint
from geoskill.model.bilinear import Bilinear
from geoskill.model.message_passing import MessagePassing
from geoskill.model.scorer import InstanceScorer, Motif

POINT, LINE = NodeType.POINT, NodeType.LINE
DIMS = {POINT: 6, LINE: 9}
FEATURES = 8

SCORERS: dict[str, Callable[[Motif], InstanceScorer]] = {
    "message passing": lambda motif: MessagePassing(
        motif, hidden_dim=8, layers=3, shared_weights=True, read_out="perceptron"
    ),
    "message passing, separate weights": lambda motif: MessagePassing(
        motif, hidden_dim=8, layers=2, shared_weights=False, read_out="product"
    ),
    "bilinear": lambda motif: Bilinear(motif, hidden_dim=8),
}
MOTIFS = {
    kernel.name: Motif.of(kernel, {role: DIMS[role] for role in kernel.roles})
    for kernel in (PointToPoint(), PointToLine(), LineToLine())
} | {
    "path": Motif((POINT,) * 3, ((0, 1), (1, 2), (1, 0), (2, 1)), ((0, 1, 2), (2, 1, 0)), {POINT: 6}),
}
every_scorer = pytest.mark.parametrize("scorer", SCORERS)
every_motif = pytest.mark.parametrize("motif", MOTIFS)


def case(scorer: str, motif: str, seed: int = 0) -> tuple[InstanceScorer, dict[NodeType, Tensor]]:
    torch.manual_seed(seed)
    network = SCORERS[scorer](MOTIFS[motif]).double()
    descriptors = {
        node_type: torch.nn.functional.normalize(torch.randn(FEATURES, dim, dtype=torch.float64))
        for node_type, dim in MOTIFS[motif].descriptor_dims.items()
    }
    return network, descriptors


def some_instances(motif: str, count: int = 20) -> Tensor:
    generator = torch.Generator().manual_seed(1)
    return torch.randint(FEATURES, (len(MOTIFS[motif].roles), count), generator=generator)


def test_motif_of_kernel() -> None:
    kernel: Kernel = PointToPoint()
    motif = Motif.of(kernel, {POINT: 128})
    assert motif == Motif((POINT, POINT), ((0, 1), (1, 0)), ((0, 1), (1, 0)), {POINT: 128})


def test_scorer_names_are_those_of_their_files() -> None:
    names = {}
    for path in Path(geoskill.model.scorer.__file__).parent.glob("*.py"):
        module = importlib.import_module(f"geoskill.model.{path.stem}")
        for value in vars(module).values():
            is_own_class = inspect.isclass(value) and value.__module__ == module.__name__
            if is_own_class and issubclass(value, InstanceScorer) and value is not InstanceScorer:
                assert getattr(value, "__final__", False)
                names[path.stem] = value.name
    assert names == {name: name for name in ("bilinear", "message_passing", "prototypes")}


@pytest.mark.slow
@every_scorer
@every_motif
@settings(max_examples=15, deadline=None)
@given(data=st.data())
def test_scores_are_invariant_under_automorphisms(scorer: str, motif: str, data: st.DataObject) -> None:
    network, descriptors = case(scorer, motif)
    roles = MOTIFS[motif].roles
    instance = st.tuples(*[st.integers(0, FEATURES - 1)] * len(roles))
    index = torch.tensor(data.draw(st.lists(instance, min_size=1, max_size=6))).T
    scores = network(descriptors, index)
    for order in MOTIFS[motif].automorphisms:
        torch.testing.assert_close(network(descriptors, index[list(order)]), scores, rtol=0, atol=1e-12)


@every_scorer
def test_scores_depend_on_the_order_of_distinct_nodes(scorer: str) -> None:
    """The middle of a path differs from its ends, so a score that ignored the order would fail here."""
    network, descriptors = case(scorer, "path")
    index = some_instances("path")
    different = (network(descriptors, index) - network(descriptors, index[[1, 0, 2]])).abs()
    assert (different[(index[0] != index[1])] > 1e-9).all()


@pytest.mark.slow
@every_scorer
@every_motif
@settings(max_examples=10, deadline=None)
@given(order=st.permutations(range(20)))
def test_scores_follow_the_order_of_instances(scorer: str, motif: str, order: list[int]) -> None:
    network, descriptors = case(scorer, motif)
    index = some_instances(motif)
    expected = network(descriptors, index)[order]
    torch.testing.assert_close(network(descriptors, index[:, order]), expected, rtol=0, atol=1e-12)


@every_scorer
@every_motif
def test_scores_are_invariant_under_permutation_of_features(scorer: str, motif: str) -> None:
    network, descriptors = case(scorer, motif)
    index = some_instances(motif)
    order = torch.randperm(FEATURES)
    shuffled = {node_type: x[order] for node_type, x in descriptors.items()}
    torch.testing.assert_close(
        network(shuffled, torch.argsort(order)[index]), network(descriptors, index), rtol=0, atol=1e-12
    )


@every_scorer
@every_motif
def test_scores_depend_on_own_features_only(scorer: str, motif: str) -> None:
    network, descriptors = case(scorer, motif)
    index = some_instances(motif)
    wanted = [x.requires_grad_() for x in descriptors.values()]
    for number in (0, 7):
        gradients = torch.autograd.grad(network(descriptors, index)[number], wanted)
        for node_type, gradient in zip(descriptors, gradients, strict=True):
            own_features = {
                int(row[number]) for role, row in zip(MOTIFS[motif].roles, index, strict=True) if role is node_type
            }
            assert {int(feature) for feature in gradient.abs().sum(dim=1).nonzero()} == own_features


@every_scorer
@every_motif
def test_gradient_reaches_every_parameter(scorer: str, motif: str) -> None:
    network, descriptors = case(scorer, motif)
    scores = network(descriptors, some_instances(motif))
    (scores @ torch.randn_like(scores)).backward()
    without = [
        name for name, parameter in network.named_parameters() if parameter.grad is None or not parameter.grad.any()
    ]
    assert without == []


@every_scorer
@every_motif
def test_scores_of_no_instance(scorer: str, motif: str) -> None:
    network, descriptors = case(scorer, motif)
    assert network(descriptors, some_instances(motif, count=0)).shape == (0,)
    no_features = {node_type: x[:0] for node_type, x in descriptors.items()}
    assert network(no_features, some_instances(motif, count=0)).shape == (0,)
