"""What is particular to the message passing; that it computes the right thing is in test_reference.py."""

import pytest
import torch

from geoskill.errors import InputError
from geoskill.geometry.primitives import NodeType
from geoskill.kernels.p2p import PointToPoint
from geoskill.model.message_passing import MessageLayer, MessagePassing
from geoskill.model.scorer import Motif

POINT = NodeType.POINT
P2P = Motif.of(PointToPoint(), {POINT: 6})
PATH = Motif((POINT,) * 3, ((0, 1), (1, 2), (1, 0), (2, 1)), ((0, 1, 2), (2, 1, 0)), {POINT: 6})


@pytest.mark.parametrize(
    ("name", "value"), [("hidden_dim", 0), ("hidden_dim", -1), ("layers", 0), ("layers", -5), ("direct_dim", 0)]
)
def test_sizes_below_one_are_refused(name: str, value: int) -> None:
    with pytest.raises(InputError, match=rf"^model\.{name}={value}: expected at least 1$"):
        MessagePassing(
            P2P, **({"hidden_dim": 4, "layers": 2, "shared_weights": True, "read_out": "perceptron"} | {name: value})
        )


def test_shared_weights_are_one_layer_for_all_steps() -> None:
    scorer = MessagePassing(P2P, hidden_dim=4, layers=3, shared_weights=True, read_out="perceptron")
    assert len(scorer.layers) == 1
    assert scorer.layer(0) is scorer.layer(2)


def test_separate_weights_are_one_layer_for_each_step() -> None:
    scorer = MessagePassing(P2P, hidden_dim=4, layers=3, shared_weights=False, read_out="perceptron")
    assert len({scorer.layer(step) for step in range(3)}) == 3


def test_messages_are_summed_at_the_node() -> None:
    """The middle of a path gets two messages, the bias of the output layer with each."""
    torch.manual_seed(0)
    layer = MessageLayer(4).double()
    left, middle, right = torch.randn(3, 5, 4, dtype=torch.float64)
    updated = layer([left, middle, right], PATH.edges)
    both = layer.message(left, middle) + layer.message(right, middle)
    torch.testing.assert_close(updated[1], layer.update(both, middle), rtol=0, atol=1e-12)
    torch.testing.assert_close(updated[0], layer.update(layer.message(middle, left), left), rtol=0, atol=1e-12)


def test_a_message_tells_its_source_from_its_destination() -> None:
    torch.manual_seed(0)
    layer = MessageLayer(4)
    a, b = torch.randn(2, 1, 4)
    assert (layer.message(a, b) - layer.message(b, a)).abs().max() > 1e-3


@pytest.mark.parametrize(("steps", "reached"), [(1, False), (2, True)])
def test_a_step_carries_information_one_edge_further(steps: int, reached: bool) -> None:
    """The end of a path hears of the other end in the second step."""
    torch.manual_seed(0)
    layer = MessageLayer(4)
    states = list(torch.randn(3, 1, 4))
    start = states[0].requires_grad_()
    for _ in range(steps):
        states = layer(states, PATH.edges)
    gradient = torch.autograd.grad(states[2].sum(), start, allow_unused=True)[0]
    assert (gradient is not None and bool(gradient.any())) == reached
