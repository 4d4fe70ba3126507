"""Read-outs: from the final states of an instance's nodes to its relevance ``b``, symmetric under automorphisms."""

from abc import ABC, abstractmethod
from typing import final

import torch
from jaxtyping import Float
from torch import Tensor, nn

from geoskill.errors import InputError
from geoskill.model.scorer import Motif


class ReadOut(nn.Module, ABC):
    """A network that reads one number from the states of an instance's nodes.

    Under autocast, the last sum is computed in the precision of the weights: with the eight bits of bfloat16, two
    instances would have equal scores too often.
    """

    @abstractmethod
    def forward(self, states: list[Float[Tensor, "m h"]]) -> Float[Tensor, " m"]:
        """Return the relevance of ``m`` instances, given one tensor of states per node of the motif."""


@final
class PerceptronReadOut(ReadOut):
    """The paper's read-out: a perceptron on all states side by side, averaged over the automorphisms.

    The average is design choice 3 (docs/design-choices.md). The score is a sum of what the nodes contribute, so one
    node that the task needs can lift an instance whatever the other node is.
    """

    def __init__(self, motif: Motif, hidden_dim: int) -> None:
        super().__init__()
        self.orders = motif.automorphisms
        self.network = nn.Sequential(
            nn.Linear(len(motif.roles) * hidden_dim, hidden_dim), nn.ReLU(), nn.Linear(hidden_dim, 1)
        )

    def forward(self, states: list[Float[Tensor, "m h"]]) -> Float[Tensor, " m"]:
        """Return the relevance; see :meth:`ReadOut.forward`."""
        first, _, last = self.network
        assert isinstance(first, nn.Linear)
        assert isinstance(last, nn.Linear)
        # A state is multiplied by the columns of the first layer that belong to its role: nothing is put side by side.
        columns = first.weight.chunk(len(states), dim=1)
        pairs = sorted({(node, role) for order in self.orders for role, node in enumerate(order)})
        terms = {(node, role): nn.functional.linear(states[node], columns[role]) for node, role in pairs}
        sums = [sum((terms[node, role] for role, node in enumerate(order)), first.bias) for order in self.orders]
        inner = torch.stack([torch.relu(order_sum) for order_sum in sums]).mean(dim=0)
        with torch.autocast(inner.device.type, enabled=False):
            scores: Tensor = last(inner.to(last.weight.dtype))
        return scores.squeeze(1)


@final
class ProductReadOut(ReadOut):
    """A sum over the motif's directed edges (i, j) of ``u(h_i) . v(h_j)``, with two perceptrons u and v.

    A product is large only when the task needs both of its nodes. A feature that no demonstration showed, such as one
    of a robot's gripper, has small u and v and lifts no instance.
    """

    def __init__(self, motif: Motif, hidden_dim: int) -> None:
        super().__init__()
        self.edges = motif.edges
        width = 2 * hidden_dim
        self.scale = width**-0.5
        self.source, self.destination = (
            nn.Sequential(nn.Linear(hidden_dim, hidden_dim), nn.ReLU(), nn.Linear(hidden_dim, width)) for _ in range(2)
        )

    def forward(self, states: list[Float[Tensor, "m h"]]) -> Float[Tensor, " m"]:
        """Return the relevance; see :meth:`ReadOut.forward`."""
        dtype = self.source[0].weight.dtype
        sources = [self.source(state).to(dtype) for state in states]
        destinations = [self.destination(state).to(dtype) for state in states]
        products = [(sources[i] * destinations[j]).sum(dim=1) for i, j in self.edges]
        total: Tensor = torch.stack(products).sum(dim=0) * self.scale
        return total


def build_read_out(read_out: str, motif: Motif, hidden_dim: int) -> ReadOut:
    """Build the read-out of this name, ``perceptron`` or ``product``.

    Raises:
        InputError: when there is no such read-out.
    """
    match read_out:
        case "perceptron":
            return PerceptronReadOut(motif, hidden_dim)
        case "product":
            return ProductReadOut(motif, hidden_dim)
    raise InputError(f"read_out={read_out}: expected perceptron or product")
