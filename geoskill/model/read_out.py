"""From the final states of an instance's nodes to its relevance ``b``, symmetric under the motif's automorphisms."""

from abc import ABC, abstractmethod
from typing import final

import torch
from jaxtyping import Float
from torch import Tensor, nn

from geoskill.errors import InputError
from geoskill.model.scorer import Motif


class ReadOut(nn.Module, ABC):
    """Reads one number from the states of each instance's nodes.

    Under autocast, the last sum is of the weights' precision: eight bits would make two instances equal too often.
    """

    @abstractmethod
    def forward(self, states: list[Float[Tensor, "m h"]]) -> Float[Tensor, " m"]:
        """The relevance of ``m`` instances; one tensor of states per node of the motif."""


@final
class PerceptronReadOut(ReadOut):
    """The paper's: a perceptron on all states side by side, averaged over the automorphisms (METHOD #3).

    A sum of what its parts say: one node that the task needs can lift an instance whatever the other node is.
    """

    def __init__(self, motif: Motif, hidden_dim: int) -> None:
        super().__init__()
        self.orders = motif.automorphisms
        self.network = nn.Sequential(
            nn.Linear(len(motif.roles) * hidden_dim, hidden_dim), nn.ReLU(), nn.Linear(hidden_dim, 1)
        )

    def forward(self, states: list[Float[Tensor, "m h"]]) -> Float[Tensor, " m"]:
        """See :meth:`ReadOut.forward`."""
        first, _, last = self.network
        assert isinstance(first, nn.Linear)
        assert isinstance(last, nn.Linear)
        # Each state times the part of the first layer for the place where it is: nothing is put side by side.
        parts = first.weight.chunk(len(states), dim=1)
        places = sorted({(node, role) for order in self.orders for role, node in enumerate(order)})
        terms = {(node, role): nn.functional.linear(states[node], parts[role]) for node, role in places}
        sums = [sum((terms[node, role] for role, node in enumerate(order)), first.bias) for order in self.orders]
        inner = torch.stack([torch.relu(each) for each in sums]).mean(dim=0)
        with torch.autocast(inner.device.type, enabled=False):
            scores: Tensor = last(inner.to(last.weight.dtype))
        return scores.squeeze(1)


@final
class ProductReadOut(ReadOut):
    """Sum over the motif's directed edges (i, j) of ``u(h_i) . v(h_j)`` with two perceptrons u and v.

    A product is large only when both of its nodes are what the task needs. A feature that no demonstration showed, such
    as one of a robot's gripper, has a small u and v and lifts nothing.
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
        """See :meth:`ReadOut.forward`."""
        own = self.source[0].weight.dtype
        sources = [self.source(state).to(own) for state in states]
        destinations = [self.destination(state).to(own) for state in states]
        products = [(sources[i] * destinations[j]).sum(dim=1) for i, j in self.edges]
        total: Tensor = torch.stack(products).sum(dim=0) * self.scale
        return total


def build_read_out(kind: str, motif: Motif, hidden_dim: int) -> ReadOut:
    """The read-out of this name: ``perceptron`` or ``product``.

    Raises:
        InputError: when there is none.
    """
    match kind:
        case "perceptron":
            return PerceptronReadOut(motif, hidden_dim)
        case "product":
            return ProductReadOut(motif, hidden_dim)
    raise InputError(f"model.read_out={kind}: expected perceptron or product")
