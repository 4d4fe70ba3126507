"""What a cascade looks at, and what the others get."""

import pytest
import torch
from torch import Tensor
from torch.nn.functional import normalize

from geoskill.geometry.primitives import NodeType
from geoskill.kernels.kernel import Kernel
from geoskill.kernels.l2l import LineToLine
from geoskill.kernels.p2l import PointToLine
from geoskill.kernels.p2p import PointToPoint
from geoskill.model.cascade import PARTNERS, cascade, main_effects
from geoskill.model.message_passing import MessagePassing
from geoskill.model.scorer import Motif

POINT, LINE = NodeType.POINT, NodeType.LINE
DIMS = {POINT: 6, LINE: 9}
KERNELS = [PointToPoint(), PointToLine(), LineToLine()]
every_kernel = pytest.mark.parametrize("kernel", KERNELS, ids=lambda kernel: kernel.name)
P2P = Motif.of(PointToPoint(), {POINT: 6})
PATH = Motif((POINT,) * 3, ((0, 1), (1, 2), (1, 0), (2, 1)), ((0, 1, 2), (2, 1, 0)), {POINT: 6})
CPU = torch.device("cpu")


def network(kernel: Kernel, budget: int | None, prototypes: int | None = 16) -> MessagePassing:
    torch.manual_seed(0)
    scorer = MessagePassing(
        Motif.of(kernel, {kind: DIMS[kind] for kind in kernel.roles}),
        hidden_dim=8,
        layers=3,
        shared_weights=True,
        read_out="product",
        prototypes=prototypes,
        cascade=budget,
    ).double()
    scorer.fit_prototypes(frame(kernel, 30, seed=1))
    return scorer.eval()


def frame(kernel: Kernel, count: int, seed: int = 0) -> dict[NodeType, Tensor]:
    generator = torch.Generator().manual_seed(seed)
    return {
        kind: normalize(torch.randn(count, DIMS[kind], generator=generator, dtype=torch.float64))
        for kind in dict.fromkeys(kernel.roles)
    }


def instances(kernel: Kernel, count: int) -> Tensor:
    return kernel.instances(dict.fromkeys(kernel.roles, count))


def test_a_small_case_by_hand() -> None:
    """Three points; the partners of each are 0, 1, 1 and 2.

    The costly part is a table, in which their means are 2.5, 4 and 3.5. The estimates of 0-1, 0-2 and 1-2 are 16.5, 7
    and 7.5. The best two are exactly 13 and 3, on average 4 less than estimated, and so the third is at 7 - 4.
    """
    table = torch.tensor([[0.0, 3.0, 4.0], [3.0, 5.0, 3.0], [4.0, 3.0, 4.0]])
    cheap = torch.tensor([10.0, 1.0, 0.0])
    seen = []

    def costly(index: Tensor) -> Tensor:
        seen.append(index.T.tolist())
        return table[index[0], index[1]]

    index = torch.tensor([[0, 0, 1], [1, 2, 2]])
    (effects, others) = main_effects(costly, P2P, {POINT: 3}, CPU)
    assert effects.tolist() == others.tolist() == [2.5, 4.0, 3.5]
    scores = cascade(cheap, costly, P2P, {POINT: 3}, index, budget=2)
    assert seen[-1] == [[0, 1], [1, 2]]
    torch.testing.assert_close(scores, torch.tensor([13.0, 3.0, 3.0]))


@pytest.mark.parametrize("motif", [P2P, Motif.of(PointToLine(), DIMS), PATH], ids=["p2p", "p2l", "path"])
@pytest.mark.parametrize("budget", [1, 3, 19])
def test_additive_scores_are_found_exactly(motif: Motif, budget: int) -> None:
    """Whatever is looked at: the estimates lack a constant only, and get it from what is."""
    generator = torch.Generator().manual_seed(0)
    of_kind = {kind: torch.randn(9, generator=generator, dtype=torch.float64) for kind in DIMS}
    index = torch.randint(9, (len(motif.roles), 20), generator=generator)
    cheap = torch.randn(20, generator=generator, dtype=torch.float64)

    def costly(chosen: Tensor) -> Tensor:
        return 5 + torch.stack([of_kind[role][row] for role, row in zip(motif.roles, chosen, strict=True)]).sum(dim=0)

    scores = cascade(cheap, costly, motif, dict.fromkeys(DIMS, 9), index, budget)
    torch.testing.assert_close(scores, cheap + costly(index), rtol=0, atol=1e-12)


@every_kernel
@pytest.mark.parametrize("budget", [1, 5, 40])
@pytest.mark.parametrize("prototypes", [16, None])
def test_those_looked_at_have_the_scores_of_the_whole_network_and_one_of_them_is_first(
    kernel: Kernel, budget: int, prototypes: int | None
) -> None:
    descriptors, index = frame(kernel, 12), instances(kernel, 12)
    assert index.shape[1] > budget
    expected, scores = (network(kernel, each, prototypes)(descriptors, index) for each in (None, budget))
    looked_at = (scores - expected).abs() < 1e-9
    assert int(looked_at.sum()) == budget
    assert float((scores.max() - scores[looked_at].max()).detach()) <= 1e-9
    # The others are ordered by their estimates, which are not those of the network.
    assert (scores - expected)[~looked_at].abs().median() > 1e-6


@every_kernel
@pytest.mark.parametrize("more", [0, 1, 1000])
def test_with_no_more_instances_than_it_looks_at_nothing_changes(kernel: Kernel, more: int) -> None:
    descriptors, index = frame(kernel, 6), instances(kernel, 6)
    assert torch.equal(
        network(kernel, index.shape[1] + more)(descriptors, index), network(kernel, None)(descriptors, index)
    )


@every_kernel
def test_in_training_all_are_looked_at(kernel: Kernel) -> None:
    descriptors, index = frame(kernel, 6), instances(kernel, 6)
    assert torch.equal(network(kernel, 1).train()(descriptors, index), network(kernel, None)(descriptors, index))


@pytest.mark.parametrize("count", [0, 1])
def test_without_an_instance_there_is_no_score(count: int) -> None:
    kernel = PointToPoint()
    assert network(kernel, 1)(frame(kernel, count), instances(kernel, count)).shape == (0,)


def test_a_single_feature_of_a_type_is_enough() -> None:
    kernel = PointToLine()
    descriptors = frame(kernel, 4)
    descriptors[LINE] = descriptors[LINE][:1]
    index = kernel.instances({POINT: 4, LINE: 1})
    scores, expected = network(kernel, 2)(descriptors, index), network(kernel, None)(descriptors, index)
    assert int(((scores - expected).abs() < 1e-9).sum()) >= 2


def test_ties_are_broken_and_no_more_than_the_budget_is_looked_at() -> None:
    kernel = PointToPoint()
    descriptors = {POINT: frame(kernel, 1)[POINT].expand(9, -1)}
    index = instances(kernel, 9)
    scores = network(kernel, 5)(descriptors, index)
    torch.testing.assert_close(scores, network(kernel, None)(descriptors, index), rtol=0, atol=1e-9)


@every_kernel
def test_messages_pass_in_few_instances(kernel: Kernel, monkeypatch: pytest.MonkeyPatch) -> None:
    scorer, count, passed = network(kernel, 10), 20, []
    original = scorer._score
    monkeypatch.setattr(scorer, "_score", lambda *given: passed.append(given[-2].shape[1]) or original(*given))
    scorer(frame(kernel, count), instances(kernel, count))
    distinct_roles = 2 if isinstance(kernel, PointToLine) else 1
    assert sum(passed) == distinct_roles * PARTNERS * count + 10


def test_gradients_are_those_of_the_scores_that_it_gives() -> None:
    kernel = PointToPoint()
    scorer, index = network(kernel, 4), instances(kernel, 6)
    given = frame(kernel, 6)[POINT].requires_grad_()
    assert torch.autograd.gradcheck(lambda x: scorer({POINT: x}, index), given)


def test_the_weights_are_those_of_a_network_without() -> None:
    """And so a checkpoint of before there were cascades loads."""
    with_it, without = network(PointToPoint(), 4), network(PointToPoint(), None)
    assert with_it.state_dict().keys() == without.state_dict().keys()
    with_it.load_state_dict(without.state_dict())
