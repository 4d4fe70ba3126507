import math
from itertools import permutations

import pytest
import torch
from torch.nn.functional import normalize

from geoskill.errors import InputError
from geoskill.geometry.primitives import NodeType
from geoskill.kernels.p2l import PointToLine
from geoskill.kernels.p2p import PointToPoint
from geoskill.model.prototypes import GAIN, SCALE, PrototypeMixture
from geoskill.model.scorer import Motif

POINT, LINE = NodeType.POINT, NodeType.LINE
P2P = Motif.of(PointToPoint(), {POINT: 6})
P2L = Motif.of(PointToLine(), {POINT: 6, LINE: 9})
TRIANGLE = Motif(
    (POINT,) * 3, tuple((i, j) for i in range(3) for j in range(3) if i != j), tuple(permutations(range(3))), {POINT: 6}
)


def features(count: int, dim: int = 6, seed: int = 0) -> torch.Tensor:
    generator = torch.Generator().manual_seed(seed)
    return normalize(torch.randn(count, dim, generator=generator, dtype=torch.float64))


@pytest.mark.parametrize("motif", [P2P, P2L, TRIANGLE], ids=["p2p", "p2l", "triangle"])
def test_prototype_scores_by_hand(motif: Motif) -> None:
    torch.manual_seed(0)
    scorer = PrototypeMixture(motif, prototypes=4, components=2).double()
    scorer.fit_prototypes({node_type: features(4, dim) for node_type, dim in motif.descriptor_dims.items()})
    given = {node_type: features(5, dim, seed=1) for node_type, dim in motif.descriptor_dims.items()}
    index = torch.tensor([[0, 1, 4], [1, 3, 0], [2, 4, 1]])[:, : len(motif.roles)].T

    def similarity(role: int, component: int, feature: int) -> float:
        node_type = motif.roles[role]
        prototypes, window = scorer.get_buffer(f"{node_type}_prototypes"), scorer.get_buffer(f"{node_type}_window")
        weights = scorer.weights[role].detach()[:, component]
        return sum(
            math.exp(GAIN * float(weight) + float((given[node_type][feature] @ prototype - 1) / window))
            for weight, prototype in zip(weights, prototypes, strict=True)
        )

    expected = [
        SCALE
        * math.log(
            sum(
                math.prod(similarity(role, component, instance[node]) for role, node in enumerate(order))
                for order in motif.automorphisms
                for component in range(2)
            )
        )
        for instance in index.T.tolist()
    ]
    torch.testing.assert_close(scorer(given, index).tolist(), expected, rtol=0, atol=1e-9)


@pytest.mark.parametrize("motif", [P2P, P2L], ids=["p2p", "p2l"])
@pytest.mark.parametrize("factor", [1.0, 30.0], ids=["as learned", "far apart"])
def test_table_of_pairs_equals_scores_one_by_one(motif: Motif, factor: float) -> None:
    """In float32. With weights 30 times as far apart, a product of matrices would underflow and overflow."""
    torch.manual_seed(0)
    scorer = PrototypeMixture(motif, prototypes=12, components=3)
    with torch.no_grad():
        for weights in scorer.weights:
            weights.mul_(factor).clamp_(-60 / GAIN, 60 / GAIN)
    scorer.fit_prototypes({node_type: features(12, dim).float() for node_type, dim in motif.descriptor_dims.items()})
    given = {
        node_type: features(7, dim, seed=1).float().requires_grad_() for node_type, dim in motif.descriptor_dims.items()
    }
    index = torch.combinations(torch.arange(7)).T if motif is P2P else torch.cartesian_prod(*[torch.arange(7)] * 2).T
    wanted = [*given.values(), *scorer.parameters()]
    together, one_by_one = (
        [scores, *torch.autograd.grad(scores.square().mean().sqrt(), wanted)]
        for scores in (scorer(given, index), torch.cat([scorer(given, instance[:, None]) for instance in index.T]))
    )
    for result, expected in zip(together, one_by_one, strict=True):
        assert torch.isfinite(result).all()
        torch.testing.assert_close(result, expected, rtol=1e-4, atol=1e-5)


def test_fit_prototypes_takes_features_in_equal_shares() -> None:
    scorer = PrototypeMixture(P2P, prototypes=64).double()
    demonstrated = features(16)
    scorer.fit_prototypes({POINT: demonstrated})
    nearest = (scorer.get_buffer("point_prototypes") @ demonstrated.T).max(dim=1)
    assert nearest.values.min() > 1 - 1e-12
    assert set(torch.bincount(nearest.indices, minlength=16).tolist()) <= {3, 4, 5}


@pytest.mark.parametrize("prototypes", [1, 8])
def test_fit_prototypes_with_a_single_feature(prototypes: int) -> None:
    scorer = PrototypeMixture(P2P, prototypes=prototypes).double()
    scorer.fit_prototypes({POINT: features(1)})
    similar, dissimilar = scorer({POINT: torch.cat([features(1), -features(1)])}, torch.tensor([[0, 1], [0, 1]]))
    assert torch.isfinite(dissimilar)
    assert similar > dissimilar


def test_fit_prototypes_repeats_few_features() -> None:
    scorer = PrototypeMixture(P2P, prototypes=8).double()
    scorer.fit_prototypes({POINT: features(1)})
    torch.testing.assert_close(scorer.get_buffer("point_prototypes"), features(1).expand(8, -1), rtol=0, atol=0)


def test_prototype_score_falls_with_distance() -> None:
    """At any distance: there is no plateau on which all unknown features have the same score."""
    torch.manual_seed(0)
    scorer = PrototypeMixture(P2P, prototypes=8).double()
    known = features(8).abs()  # like SIFT's, so there is a direction away from all of them
    scorer.fit_prototypes({POINT: known})
    steps = torch.linspace(0, 1, 20, dtype=torch.float64)[:, None]
    path = normalize((1 - steps) * known[0] - steps * normalize(known.mean(dim=0), dim=0))
    index = torch.stack([torch.arange(20), torch.full((20,), 20)])
    scores = scorer({POINT: torch.cat([path, known[1:2]])}, index)
    assert torch.isfinite(scores).all()
    assert (scores[1:] < scores[:-1]).all()
    assert scores[-1] < scores[0] - 10 * SCALE


def test_prototype_score_has_gradient_far_from_all_prototypes() -> None:
    """In float32, where the exponentials themselves are zero."""
    torch.manual_seed(0)
    scorer = PrototypeMixture(P2P, prototypes=8)
    known = features(8).float()
    scorer.fit_prototypes({POINT: known})
    scorer.get_buffer("point_window").fill_(1e-3)
    given = (-known[:2]).requires_grad_()
    scorer({POINT: given}, torch.tensor([[0], [1]])).sum().backward()
    assert given.grad is not None
    assert torch.isfinite(given.grad).all()
    assert given.grad.abs().max() > 1


def test_prototype_scores_are_equal_before_fit() -> None:
    scorer = PrototypeMixture(P2P, prototypes=8).double()
    scores = scorer({POINT: features(4)}, torch.combinations(torch.arange(4)).T)
    torch.testing.assert_close(scores, scores[:1].expand(6), rtol=0, atol=1e-9)


def test_fit_prototypes_rejects_no_features() -> None:
    with pytest.raises(ValueError, match=r"^no point descriptors; expected those of the demonstration's features$"):
        PrototypeMixture(P2P, prototypes=8).fit_prototypes({POINT: torch.zeros(0, 6)})


@pytest.mark.parametrize(("name", "value"), [("prototypes", 0), ("components", -1)])
def test_prototype_mixture_rejects_sizes_below_one(name: str, value: int) -> None:
    with pytest.raises(InputError, match=rf"^{name}={value}: expected at least 1$"):
        PrototypeMixture(P2P, **({"prototypes": 4} | {name: value}))
