"""Message passing over the motif: the paper's network (section III-B, after Gilmer et al., ICML 2017)."""

from collections.abc import Mapping
from typing import final

import torch
from jaxtyping import Float, Int64
from torch import Tensor, nn

from geoskill.errors import InputError
from geoskill.geometry.primitives import NodeType
from geoskill.model.bilinear import Bilinear
from geoskill.model.encoder import DescriptorEncoder
from geoskill.model.read_out import build_read_out
from geoskill.model.scorer import InstanceScorer, Motif


@final
class MessageLayer(nn.Module):
    """One step: messages along the edges, summed at each node, taken in by a gated recurrent unit (equations 2 to 4).

    The message function is a perceptron with one hidden layer on the two states side by side. Its first layer is kept
    as two matrices, one for the source and one for the destination, so that each state is multiplied once however many
    edges it has.
    """

    def __init__(self, hidden_dim: int) -> None:
        super().__init__()
        self.source = nn.Linear(hidden_dim, hidden_dim)
        self.destination = nn.Linear(hidden_dim, hidden_dim, bias=False)
        self.output = nn.Linear(hidden_dim, hidden_dim)
        self.update = nn.GRUCell(hidden_dim, hidden_dim)

    def message(self, source: Float[Tensor, "... h"], destination: Float[Tensor, "... h"]) -> Float[Tensor, "... h"]:
        """The message from one node's state to another's; the reference implementation calls it too."""
        message: Tensor = self.output(torch.relu(self.source(source) + self.destination(destination)))
        return message

    def forward(
        self, states: list[Float[Tensor, "m h"]], edges: tuple[tuple[int, int], ...]
    ) -> list[Float[Tensor, "m h"]]:
        """The next state of each of the motif's nodes, for ``m`` instances at once."""
        sources = [self.source(state) for state in states]
        destinations = [self.destination(state) for state in states]
        updated = []
        for node, state in enumerate(states):
            incoming = [i for i, j in edges if j == node]
            # The output layer is linear: summing before it, with its bias once per message, is the sum of the messages.
            inner = [torch.relu(sources[i] + destinations[node]) for i in incoming]
            total = nn.functional.linear(sum(inner[1:], inner[0]), self.output.weight, self.output.bias * len(inner))
            updated.append(self.update(total, state))
        return updated


@final
class MessagePassing(InstanceScorer):
    """``T`` steps of message passing, then a read-out of the final states.

    Args:
        motif: what an instance looks like.
        hidden_dim: ``h``.
        layers: ``T``.
        encoder_dim: width of the descriptors' encoder; None for a linear one.
        read_out: ``perceptron`` on the final states, as in the paper, or ``product`` of two of them.
        shared_weights: one set of weights for all steps, as in Gilmer et al., or one for each.
        direct_dim: width of a factorised score of the descriptors themselves (:class:`Bilinear`), which is added to
            what message passing says; None for none. Messages let an unknown partner change the state of a known
            feature in ways that no demonstration has shown; the direct score cannot be changed by it.

    Raises:
        InputError: when ``hidden_dim``, ``layers`` or ``direct_dim`` is below 1.
    """

    def __init__(
        self,
        motif: Motif,
        *,
        hidden_dim: int,
        layers: int,
        shared_weights: bool,
        read_out: str,
        encoder_dim: int | None = None,
        direct_dim: int | None = None,
    ) -> None:
        super().__init__()
        for name, value in (("hidden_dim", hidden_dim), ("layers", layers), ("direct_dim", direct_dim)):
            if value is not None and value < 1:
                raise InputError(f"model.{name}={value}: expected at least 1")
        self.motif = motif
        self.steps = layers
        self.encoder = DescriptorEncoder(motif.descriptor_dims, hidden_dim, encoder_dim)
        self.layers = nn.ModuleList(MessageLayer(hidden_dim) for _ in range(1 if shared_weights else layers))
        self.read_out = build_read_out(read_out, motif, hidden_dim)
        self.direct = None if direct_dim is None else Bilinear(motif, hidden_dim=direct_dim)

    def layer(self, step: int) -> MessageLayer:
        """The layer of this step."""
        layer = self.layers[step % len(self.layers)]
        assert isinstance(layer, MessageLayer)
        return layer

    def forward(
        self, descriptors: Mapping[NodeType, Float[Tensor, "n _"]], instance_index: Int64[Tensor, "k m"]
    ) -> Float[Tensor, " m"]:
        """See :meth:`InstanceScorer.forward`."""
        hidden = self.encoder(descriptors)
        states = [hidden[role][row] for role, row in zip(self.motif.roles, instance_index, strict=True)]
        for step in range(self.steps):
            states = self.layer(step)(states, self.motif.edges)
        scores: Tensor = self.read_out(states)
        return scores if self.direct is None else scores + self.direct(descriptors, instance_index)
