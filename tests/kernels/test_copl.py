"""copl: its motif, its proposals, and message passing on four nodes."""

import math

import pytest
import torch

from geoskill.geometry.primitives import NodeType
from geoskill.graphs.motif_graph import MotifGraph, with_instances
from geoskill.kernels.copl import Coplanar
from geoskill.kernels.kernel import automorphisms
from geoskill.model.message_passing import MessagePassing
from geoskill.model.prototypes import PrototypeMixture
from geoskill.model.scorer import Motif
from geoskill.testing import check_kernel

POINT = NodeType.POINT


def sides(count: int, seed: int = 0) -> torch.Tensor:
    """Half of the points within a box, the others within one half a meter to its right."""
    points = 0.1 * torch.rand(count, 3, generator=torch.Generator().manual_seed(seed))
    points[count // 2 :, 0] += 0.5
    return points


def test_kernel_keeps_its_contract() -> None:
    check_kernel(Coplanar)
    assert len(automorphisms(Coplanar)) == 24


@pytest.mark.parametrize("count", [0, 1, 3, 4, 5, 8, 30, 60])
def test_proposals_are_distinct_and_no_more_than_pairs(count: int) -> None:
    index = Coplanar().proposals({POINT: sides(count)})
    assert index.shape[0] == 4
    assert index.shape[1] <= math.comb(count, 2)
    assert (index[1:] > index[:-1]).all()
    assert len({tuple(column) for column in index.T.tolist()}) == index.shape[1]
    assert (count < 4) == (index.shape[1] == 0)


def test_proposals_join_two_points_of_either_side() -> None:
    index = Coplanar().proposals({POINT: sides(60)})
    on_the_right = (index >= 30).sum(dim=0)
    assert (on_the_right == 2).float().mean() > 0.6
    # Every two points of different sides are in some proposal.
    joined = {
        frozenset(pair) for column in index.T.tolist() for pair in torch.combinations(torch.tensor(column)).tolist()
    }
    assert sum(frozenset((one, other)) in joined for one in range(30) for other in range(30, 60)) > 0.99 * 900


def test_a_thing_of_few_points_is_a_side_of_its_own() -> None:
    few = torch.tensor([[0.3, 0.9, 0.0], [0.35, 0.92, 0.02]])
    index = Coplanar().proposals({POINT: torch.cat([sides(60), few])})
    of_the_few = (index >= 60).sum(dim=0)
    # Their other nearest points are on the boxes, and have nearer ones.
    assert set(of_the_few.tolist()) == {0, 2}


def test_proposals_do_not_depend_on_the_order_of_points() -> None:
    points = sides(20)
    order = torch.randperm(20, generator=torch.Generator().manual_seed(1))
    plain = {frozenset(column) for column in Coplanar().proposals({POINT: points}).T.tolist()}
    shuffled = Coplanar().proposals({POINT: points[order]})
    assert {frozenset(column) for column in order[shuffled].T.tolist()} == plain


def test_graph_has_proposals_of_points_with_depth_only() -> None:
    points = sides(12)
    points[3] = torch.nan
    graph = MotifGraph(point_count=torch.tensor([12]), point_space=points, point_geometry=torch.zeros(12, 2))
    index = with_instances(Coplanar(), graph).instance_index
    assert index.shape[1] > 0
    assert not (index == 3).any()


def test_score_of_four_alike_does_not_depend_on_their_order() -> None:
    motif = Motif.of(Coplanar(), {POINT: 6})
    torch.manual_seed(0)
    descriptors = {POINT: torch.nn.functional.normalize(torch.randn(9, 6, dtype=torch.float64))}
    index = torch.stack([torch.randperm(9)[:4] for _ in range(20)]).T
    networks = [
        MessagePassing(motif, hidden_dim=8, layers=2, shared_weights=True, read_out=read_out, prototypes=7)
        for read_out in ("product", "perceptron")
    ]
    for network in (*networks, PrototypeMixture(motif, prototypes=7)):
        network.double().fit_prototypes(descriptors)
        scores = network(descriptors, index)
        for order in ([1, 0, 2, 3], [3, 1, 2, 0], [2, 3, 0, 1]):
            torch.testing.assert_close(network(descriptors, index[order]), scores)
