"""The cascade: the instances that are scored exactly, and the estimates of all others."""

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
        Motif.of(kernel, {node_type: DIMS[node_type] for node_type in kernel.roles}),
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
        node_type: normalize(torch.randn(count, DIMS[node_type], generator=generator, dtype=torch.float64))
        for node_type in dict.fromkeys(kernel.roles)
    }


def instances(kernel: Kernel, count: int) -> Tensor:
    return kernel.instances(dict.fromkeys(kernel.roles, count))


def test_cascade_by_hand() -> None:
    """Three points; the partners of every point are 0, 1, 1 and 2.

    The expensive part is a table, whose means over the partners are 2.5, 4 and 3.5. The estimates of 0-1, 0-2 and 1-2
    are 16.5, 7 and 7.5. The exact scores of the best two are 13 and 3, on average 4 less than estimated, so the third
    is at 7 - 4.
    """
    table = torch.tensor([[0.0, 3.0, 4.0], [3.0, 5.0, 3.0], [4.0, 3.0, 4.0]])
    cheap = torch.tensor([10.0, 1.0, 0.0])
    scored = []

    def expensive(index: Tensor) -> Tensor:
        scored.append(index.T.tolist())
        return table[index[0], index[1]]

    index = torch.tensor([[0, 0, 1], [1, 2, 2]])
    effects, second_effects = main_effects(expensive, P2P, {POINT: 3}, CPU)
    assert effects.tolist() == second_effects.tolist() == [2.5, 4.0, 3.5]
    scores = cascade(cheap, expensive, P2P, {POINT: 3}, index, budget=2)
    assert scored[-1] == [[0, 1], [1, 2]]
    torch.testing.assert_close(scores, torch.tensor([13.0, 3.0, 3.0]))


@pytest.mark.parametrize("motif", [P2P, Motif.of(PointToLine(), DIMS), PATH], ids=["p2p", "p2l", "path"])
@pytest.mark.parametrize("budget", [1, 3, 19])
def test_cascade_is_exact_for_additive_scores(motif: Motif, budget: int) -> None:
    """With any budget: the estimates lack only a constant, which the exact scores give."""
    generator = torch.Generator().manual_seed(0)
    terms = {node_type: torch.randn(9, generator=generator, dtype=torch.float64) for node_type in DIMS}
    index = torch.randint(9, (len(motif.roles), 20), generator=generator)
    cheap = torch.randn(20, generator=generator, dtype=torch.float64)

    def expensive(chosen: Tensor) -> Tensor:
        return 5 + torch.stack([terms[role][row] for role, row in zip(motif.roles, chosen, strict=True)]).sum(dim=0)

    scores = cascade(cheap, expensive, motif, dict.fromkeys(DIMS, 9), index, budget)
    torch.testing.assert_close(scores, cheap + expensive(index), rtol=0, atol=1e-12)


@every_kernel
@pytest.mark.parametrize("budget", [1, 5, 40])
@pytest.mark.parametrize("prototypes", [16, None])
def test_cascade_scores_within_budget_are_exact_and_contain_the_best(
    kernel: Kernel, budget: int, prototypes: int | None
) -> None:
    descriptors, index = frame(kernel, 12), instances(kernel, 12)
    assert index.shape[1] > budget
    expected, scores = (network(kernel, limit, prototypes)(descriptors, index) for limit in (None, budget))
    is_exact = (scores - expected).abs() < 1e-9
    assert int(is_exact.sum()) == budget
    assert float((scores.max() - scores[is_exact].max()).detach()) <= 1e-9
    # All others have estimates, which differ from the scores of the network.
    assert (scores - expected)[~is_exact].abs().median() > 1e-6


@every_kernel
@pytest.mark.parametrize("surplus", [0, 1, 1000])
def test_cascade_without_more_instances_than_budget_equals_network(kernel: Kernel, surplus: int) -> None:
    descriptors, index = frame(kernel, 6), instances(kernel, 6)
    assert torch.equal(
        network(kernel, index.shape[1] + surplus)(descriptors, index), network(kernel, None)(descriptors, index)
    )


@every_kernel
def test_cascade_is_off_in_training_mode(kernel: Kernel) -> None:
    descriptors, index = frame(kernel, 6), instances(kernel, 6)
    assert torch.equal(network(kernel, 1).train()(descriptors, index), network(kernel, None)(descriptors, index))


@pytest.mark.parametrize("count", [0, 1])
def test_cascade_without_instances(count: int) -> None:
    kernel = PointToPoint()
    assert network(kernel, 1)(frame(kernel, count), instances(kernel, count)).shape == (0,)


def test_cascade_with_a_single_line() -> None:
    kernel = PointToLine()
    descriptors = frame(kernel, 4)
    descriptors[LINE] = descriptors[LINE][:1]
    index = kernel.instances({POINT: 4, LINE: 1})
    scores, expected = network(kernel, 2)(descriptors, index), network(kernel, None)(descriptors, index)
    assert int(((scores - expected).abs() < 1e-9).sum()) >= 2


def test_cascade_with_equal_estimates() -> None:
    kernel = PointToPoint()
    descriptors = {POINT: frame(kernel, 1)[POINT].expand(9, -1)}
    index = instances(kernel, 9)
    scores = network(kernel, 5)(descriptors, index)
    torch.testing.assert_close(scores, network(kernel, None)(descriptors, index), rtol=0, atol=1e-9)


@every_kernel
def test_cascade_number_of_scored_instances(kernel: Kernel, monkeypatch: pytest.MonkeyPatch) -> None:
    scorer, count, scored = network(kernel, 10), 20, []
    original = scorer._message_scores
    monkeypatch.setattr(scorer, "_message_scores", lambda *args: scored.append(args[-2].shape[1]) or original(*args))
    scorer(frame(kernel, count), instances(kernel, count))
    distinct_roles = 2 if isinstance(kernel, PointToLine) else 1
    assert sum(scored) == distinct_roles * PARTNERS * count + 10


def test_cascade_gradients() -> None:
    kernel = PointToPoint()
    scorer, index = network(kernel, 4), instances(kernel, 6)
    descriptors = frame(kernel, 6)[POINT].requires_grad_()
    assert torch.autograd.gradcheck(lambda x: scorer({POINT: x}, index), descriptors)


def test_cascade_does_not_change_state_dict() -> None:
    """So a checkpoint of a network without cascade loads."""
    with_cascade, without = network(PointToPoint(), 4), network(PointToPoint(), None)
    assert with_cascade.state_dict().keys() == without.state_dict().keys()
    with_cascade.load_state_dict(without.state_dict())
