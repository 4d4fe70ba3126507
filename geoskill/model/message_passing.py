"""Message passing over the motif: the paper's network (section III-B, after Gilmer et al., ICML 2017)."""

from collections.abc import Mapping, Sequence
from functools import partial
from typing import ClassVar, NamedTuple, final

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

PRECISIONS = ("float32", "bfloat16")
# Numbers that autograd keeps of each node, as multiples of its state: in every step, and for the read-out, which keeps
# 2.8 to 11.6 (test_message_passing.py).
SAVED_PER_STEP, SAVED_BY_READ_OUT = 6.1, 12.0


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
        source, update, hidden_dim = self.source, self.update, self.source.in_features
        gates = slice(0, 2 * hidden_dim)  # of the unit's rows: reset, keep, and then the candidate
        return FusedLayer(
            torch.cat([source.weight, self.destination.weight, update.weight_hh[gates]]),
            torch.cat([source.bias, torch.zeros_like(source.bias), update.bias_hh[gates]]),
            update.weight_hh[2 * hidden_dim :],
            update.bias_hh[2 * hidden_dim :],
            update.weight_ih @ self.output.weight,
            update.bias_ih,
            nn.functional.linear(self.output.bias, update.weight_ih),
        )


@final
class Projection(NamedTuple):
    """What is linear in a state.

    Attributes:
        sent: ``[..., 4 h]``, as a source, as a destination, and in the gates.
        candidate: ``[..., h]``, in the unit's candidate. By itself, since autograd keeps it, and what it is a part of.
    """

    sent: Tensor
    candidate: Tensor


@final
class FusedLayer(NamedTuple):
    """A :class:`MessageLayer`'s weights, joined.

    Attributes:
        weight: ``[4 h, h]``, of what a state sends and of the unit's gates.
        bias: ``[4 h]``, of these.
        candidate_weight: ``[h, h]``, of the unit's candidate.
        candidate_bias: ``[h]``, of it.
        received_weight: ``[3 h, h]``, from the summed inner layer of the messages to the gates and the candidate.
        received_bias: ``[3 h]``, of these.
        message_bias: ``[3 h]``, what every message adds to them.
    """

    weight: Tensor
    bias: Tensor
    candidate_weight: Tensor
    candidate_bias: Tensor
    received_weight: Tensor
    received_bias: Tensor
    message_bias: Tensor

    def to(self, dtype: torch.dtype) -> "FusedLayer":
        """The same weights in another precision."""
        return FusedLayer(*(weight.to(dtype) for weight in self))

    def project(self, states: Float[Tensor, "... h"]) -> Projection:
        """All linear functions of a state."""
        linear = nn.functional.linear
        return Projection(
            linear(states, self.weight, self.bias), linear(states, self.candidate_weight, self.candidate_bias)
        )

    def next_states(
        self, states: Float[Tensor, "k m h"], projected: Projection, edges: Sequence[tuple[int, int]]
    ) -> Float[Tensor, "k m h"]:
        """The next state of each of the motif's nodes, for ``m`` instances at once.

        Args:
            states: of every node.
            projected: :meth:`project` of them.
            edges: the motif's, directed, in the order of their destinations.
        """
        hidden_dim, nodes = states.shape[-1], len(states)
        sources, destinations, gates = torch.split(projected.sent, [hidden_dim, hidden_dim, 2 * hidden_dim], dim=-1)
        senders, receivers = [i for i, _ in edges], [j for _, j in edges]
        # The output layer is linear: summing before it, with its bias once per message, is the sum of the messages. And
        # the gates are linear in that sum: both products are one.
        inner = torch.relu(sources[senders] + destinations[receivers])
        if receivers == list(range(nodes)):  # one message each
            received = nn.functional.linear(inner, self.received_weight, self.received_bias + self.message_bias)
        else:
            places = torch.tensor(receivers, device=inner.device)
            summed = torch.zeros_like(states).index_add(0, places, inner)
            counts = places.bincount(minlength=nodes).to(states.dtype)[:, None, None]
            received = nn.functional.linear(summed, self.received_weight)
            received = received + (self.received_bias + counts * self.message_bias)
        reset, keep = torch.sigmoid(received[..., : 2 * hidden_dim] + gates).chunk(2, dim=-1)
        proposed = torch.tanh(torch.addcmul(received[..., 2 * hidden_dim :], reset, projected.candidate))
        return torch.lerp(proposed, states, keep)


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
        precision: of the messages, ``float32`` or ``bfloat16``, which is faster where the processor has products of it
            and takes half the memory. Features are encoded, and compared with the demonstration, in single precision
            all the same: the likeness is an exponential of small differences.
        memory_mb: what training may keep of one batch for the backward pass, in MiB. Of a batch that needs more, states
            are computed again, a chunk of instances at a time: memory then no longer grows with their number.

    In training mode (``train()``) every instance gets messages, for what is not looked at cannot be learned from. In
    evaluation mode (``eval()``), K is of all instances that are given at once: frames of more are to be given one by
    one, since in a batch they would compete.

    Raises:
        InputError: when ``hidden_dim``, ``layers``, ``prototypes`` or ``cascade`` is below 1, ``memory_mb`` is not
            positive, or there is no such precision.
    """

    name: ClassVar[str] = "message_passing"

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
        precision: str = "float32",
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
        _require_precision(precision, "model.precision")
        self.precision = precision
        self.edges = sorted(motif.edges, key=lambda edge: edge[1])
        self.steps = layers
        self.hidden_dim = hidden_dim
        self.cascade = cascade
        self.memory_mb = memory_mb
        self.encoder = DescriptorEncoder(motif, hidden_dim, encoder_dim)
        self.layers = nn.ModuleList(MessageLayer(hidden_dim) for _ in range(1 if shared_weights else layers))
        self.read_out = build_read_out(read_out, motif, hidden_dim)
        self.prototype_score = None if prototypes is None else PrototypeMixture(motif, prototypes=prototypes)

    def layer(self, step: int) -> MessageLayer:
        """The layer of this step."""
        layer = self.layers[step % len(self.layers)]
        assert isinstance(layer, MessageLayer)
        return layer

    def use_precision(self, precision: str) -> None:
        """Let messages be of it from now on; weights stay as they are.

        Raises:
            InputError: when there is no such precision.
        """
        _require_precision(precision, "precision")
        self.precision = precision

    def fit_prototypes(self, descriptors: Mapping[NodeType, Float[Tensor, "n _"]]) -> None:
        """See :meth:`PrototypeMixture.fit_prototypes`; without prototypes, nothing."""
        if self.prototype_score is not None:
            self.prototype_score.fit_prototypes(descriptors)

    def forward(
        self, descriptors: Mapping[NodeType, Float[Tensor, "n _"]], instance_index: Int64[Tensor, "k m"]
    ) -> Float[Tensor, " m"]:
        """See :meth:`InstanceScorer.forward`. Under ``torch.autocast``, messages are of its precision."""
        device = instance_index.device.type
        given = next(iter(descriptors.values())).dtype
        low = self.precision == "bfloat16" and given == torch.float32  # and not where all is to be double
        dtype = torch.bfloat16 if low else given
        if torch.is_autocast_enabled(device):
            dtype = torch.get_autocast_dtype(device)
        with torch.autocast(device, enabled=False):
            return self._forward(descriptors, instance_index, dtype).to(given)

    def _forward(
        self,
        descriptors: Mapping[NodeType, Float[Tensor, "n _"]],
        instance_index: Int64[Tensor, "k m"],
        dtype: torch.dtype,
    ) -> Float[Tensor, " m"]:
        hidden = self.encoder(descriptors)
        # In the first step, a feature's state is the same in all of its instances, and so is all that is linear in it.
        fused = [layer.fused() for layer in map(self.layer, range(len(self.layers)))]
        if not torch.is_grad_enabled():  # else in each chunk, so that gradients add up in single precision
            fused = [layer.to(dtype) for layer in fused]
            hidden = {kind: states.to(dtype) for kind, states in hidden.items()}
        projected = {kind: fused[0].project(states) for kind, states in hidden.items()}
        bytes_of_states = dtype.itemsize * self.hidden_dim * len(self.motif.roles)
        messages: Score = partial(
            in_chunks,
            lambda index: self._score(fused, hidden, projected, index, dtype),
            working_bytes=4 * bytes_of_states,
            saved_bytes=(SAVED_PER_STEP * self.steps + SAVED_BY_READ_OUT) * bytes_of_states,
            memory_bytes=MIB * self.memory_mb,
        )
        count = instance_index.shape[1]
        if self.prototype_score is None:
            likeness = next(iter(descriptors.values())).new_zeros(count)
        else:
            likeness = self.prototype_score(descriptors, instance_index)
        if self.cascade is None or self.training or count <= self.cascade:
            scores: Tensor = messages(instance_index) + likeness
            return scores
        counts = {kind: len(rows) for kind, rows in descriptors.items()}
        return cascade(likeness, messages, self.motif, counts, instance_index, self.cascade)

    def _score(
        self,
        fused: Sequence[FusedLayer],
        hidden: Mapping[NodeType, Float[Tensor, "n h"]],
        projected: Mapping[NodeType, Projection],
        instance_index: Int64[Tensor, "k m"],
        dtype: torch.dtype,
    ) -> Float[Tensor, " m"]:
        """What message passing says of some instances."""
        fused = [layer.to(dtype) for layer in fused]
        places = list(zip(self.motif.roles, instance_index, strict=True))

        def of_nodes(rows: Mapping[NodeType, Tensor]) -> Tensor:
            return torch.stack([rows[role][row] for role, row in places]).to(dtype)

        states = of_nodes(hidden)
        first = Projection(
            of_nodes({kind: of_kind.sent for kind, of_kind in projected.items()}),
            of_nodes({kind: of_kind.candidate for kind, of_kind in projected.items()}),
        )
        for step in range(self.steps):
            layer = fused[step % len(fused)]
            states = layer.next_states(states, first if step == 0 else layer.project(states), self.edges)
        low = dtype in (torch.bfloat16, torch.float16)
        with torch.autocast(states.device.type, dtype if low else None, enabled=low):
            scores: Tensor = self.read_out(list(states))
        return scores


def _require_precision(precision: str, key: str) -> None:
    if precision not in PRECISIONS:
        raise InputError(f"{key}={precision}: expected {' or '.join(PRECISIONS)}")
