"""Message passing over the motif: the paper's network (section III-B, after Gilmer et al., ICML 2017)."""

from collections.abc import Mapping, Sequence
from functools import partial
from typing import NamedTuple, final

import torch
from jaxtyping import Float, Int64
from torch import Tensor, nn

from geoskill.errors import InputError
from geoskill.geometry.primitives import NodeType
from geoskill.model.cascade import cascade
from geoskill.model.chunks import MIB, Score, in_chunks
from geoskill.model.encoder import DescriptorEncoder
from geoskill.model.prototypes import PrototypeMixture
from geoskill.model.read_out import build_read_out
from geoskill.model.scorer import InstanceScorer, Motif

# Numbers that autograd keeps of each node and step, as multiples of its state: 13.6 and 12.6 are measured
# (test_message_passing.py), the read-out included.
SAVED_PER_STEP = 13.8


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

    def fused(self) -> "FusedLayer":
        """The same step with as few products as it needs; what is made of the weights alone is made here, once."""
        source, update = self.source, self.update
        return FusedLayer(
            torch.cat([source.weight, self.destination.weight, update.weight_hh]),
            torch.cat([source.bias, torch.zeros_like(source.bias), update.bias_hh]),
            update.weight_ih @ self.output.weight,
            update.bias_ih,
            nn.functional.linear(self.output.bias, update.weight_ih),
        )


@final
class FusedLayer(NamedTuple):
    """A :class:`MessageLayer`'s weights, joined.

    Attributes:
        weight: ``[5 h, h]``, all that is linear in a state: as a source, as a destination, and in the unit's gates.
        bias: ``[5 h]``, of these.
        received_weight: ``[3 h, h]``, from the summed inner layer of the messages to the gates.
        received_bias: ``[3 h]``, of the gates.
        message_bias: ``[3 h]``, what every message adds to them.
    """

    weight: Tensor
    bias: Tensor
    received_weight: Tensor
    received_bias: Tensor
    message_bias: Tensor

    def project(self, states: Float[Tensor, "... h"]) -> Float[Tensor, "... 5*h"]:
        """All linear functions of a state in one product."""
        return nn.functional.linear(states, self.weight, self.bias)

    def next_states(
        self,
        states: Float[Tensor, "k m h"],
        projected: Float[Tensor, "k m 5*h"],
        incoming: Sequence[Sequence[int]],
    ) -> Float[Tensor, "k m h"]:
        """The next state of each of the motif's nodes, for ``m`` instances at once.

        Args:
            states: of every node.
            projected: :meth:`project` of them.
            incoming: for each node, those that send it a message.
        """
        hidden_dim = states.shape[-1]
        sources, destinations, own = torch.split(projected, [hidden_dim, hidden_dim, 3 * hidden_dim], dim=-1)
        # The output layer is linear: summing before it, with its bias once per message, is the sum of the messages. And
        # the gates are linear in that sum: both products are one.
        inner = [
            torch.stack([torch.relu(sources[i] + destinations[node]) for i in senders]).sum(dim=0)
            for node, senders in enumerate(incoming)
        ]
        counts = states.new_tensor([len(senders) for senders in incoming])[:, None, None]
        received = nn.functional.linear(torch.stack(inner), self.received_weight)
        received = received + (self.received_bias + counts * self.message_bias)
        reset, keep = torch.sigmoid((received + own)[..., : 2 * hidden_dim]).chunk(2, dim=-1)
        proposed = torch.tanh(received[..., 2 * hidden_dim :] + reset * own[..., 2 * hidden_dim :])
        return proposed + keep * (states - proposed)


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
        prototypes: of a score of likeness to the demonstration (:class:`PrototypeMixture`), which is added to what
            message passing says; None for none. Messages let an unknown partner change the state of a known feature in
            ways that no demonstration has shown; likeness is what it cannot have.
        cascade: K, how many instances of a frame get messages, outside training: those that are estimated to be best,
            while the others keep the estimate (:mod:`geoskill.model.cascade`). None for all; with K instances or fewer
            it is all of them, too.
        memory_mb: what training may keep of one batch for the backward pass, in MiB. Of a batch that needs more, states
            are computed again, a chunk of instances at a time: memory then no longer grows with their number.

    In training mode (``train()``) every instance gets messages, for what is not looked at cannot be learned from. In
    evaluation mode (``eval()``), K is of all instances that are given at once: frames of more are to be given one by
    one, since in a batch they would compete.

    Raises:
        InputError: when ``hidden_dim``, ``layers``, ``prototypes`` or ``cascade`` is below 1, or ``memory_mb`` is not
            positive.
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
        prototypes: int | None = None,
        cascade: int | None = None,
        memory_mb: float = 1024,
    ) -> None:
        super().__init__()
        sizes = {"hidden_dim": hidden_dim, "layers": layers, "prototypes": prototypes, "cascade": cascade}
        for name, value in sizes.items():
            if value is not None and value < 1:
                raise InputError(f"model.{name}={value}: expected at least 1")
        if memory_mb <= 0:
            raise InputError(f"model.memory_mb={memory_mb:g}: expected a positive number of MiB")
        self.motif = motif
        self.steps = layers
        self.hidden_dim = hidden_dim
        self.cascade = cascade
        self.memory_mb = memory_mb
        self.encoder = DescriptorEncoder(motif.descriptor_dims, hidden_dim, encoder_dim)
        self.layers = nn.ModuleList(MessageLayer(hidden_dim) for _ in range(1 if shared_weights else layers))
        self.read_out = build_read_out(read_out, motif, hidden_dim)
        self.direct = None if prototypes is None else PrototypeMixture(motif, prototypes=prototypes)

    def layer(self, step: int) -> MessageLayer:
        """The layer of this step."""
        layer = self.layers[step % len(self.layers)]
        assert isinstance(layer, MessageLayer)
        return layer

    def remember(self, descriptors: Mapping[NodeType, Float[Tensor, "n _"]]) -> None:
        """See :meth:`PrototypeMixture.remember`; without prototypes, nothing."""
        if self.direct is not None:
            self.direct.remember(descriptors)

    def forward(
        self, descriptors: Mapping[NodeType, Float[Tensor, "n _"]], instance_index: Int64[Tensor, "k m"]
    ) -> Float[Tensor, " m"]:
        """See :meth:`InstanceScorer.forward`."""
        hidden = self.encoder(descriptors)
        # In the first step, a feature's state is the same in all of its instances, and so is all that is linear in it.
        fused = [layer.fused() for layer in map(self.layer, range(len(self.layers)))]
        projected = {kind: fused[0].project(states) for kind, states in hidden.items()}
        messages: Score = partial(
            in_chunks,
            lambda index: self._score(fused, hidden, projected, index),
            working_bytes=5 * self._bytes_of_states(),
            saved_bytes=SAVED_PER_STEP * self.steps * self._bytes_of_states(),
            memory_bytes=MIB * self.memory_mb,
        )
        count = instance_index.shape[1]
        if self.direct is None:
            likeness = next(iter(hidden.values())).new_zeros(count)
        else:
            likeness = self.direct(descriptors, instance_index)
        if self.cascade is None or self.training or count <= self.cascade:
            scores: Tensor = messages(instance_index) + likeness
            return scores
        counts = {kind: len(rows) for kind, rows in descriptors.items()}
        return cascade(likeness, messages, self.motif, counts, instance_index, self.cascade)

    def _score(
        self,
        fused: Sequence[FusedLayer],
        hidden: Mapping[NodeType, Float[Tensor, "n h"]],
        projected: Mapping[NodeType, Float[Tensor, "n 5*h"]],
        instance_index: Int64[Tensor, "k m"],
    ) -> Float[Tensor, " m"]:
        """What message passing says of some instances."""
        places = list(zip(self.motif.roles, instance_index, strict=True))
        states = torch.stack([hidden[role][row] for role, row in places])
        sent = torch.stack([projected[role][row] for role, row in places])
        incoming = [[i for i, j in self.motif.edges if j == node] for node in range(len(places))]
        for step in range(self.steps):
            layer = fused[step % len(fused)]
            states = layer.next_states(states, sent if step == 0 else layer.project(states), incoming)
        scores: Tensor = self.read_out(list(states))
        return scores

    def _bytes_of_states(self) -> int:
        """Of one single-precision state at each node of an instance."""
        return 4 * self.hidden_dim * len(self.motif.roles)
