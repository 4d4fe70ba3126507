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
# Upper bounds of the numbers that autograd keeps of a node, as multiples of its state: per step, and for the read-out
# (tested in test_message_passing.py).
SAVED_PER_STEP, SAVED_BY_READ_OUT = 6.1, 12.0


@final
class MessageLayer(nn.Module):
    """One step: messages along the edges, summed at each node and fed to a gated recurrent unit (equations 2 to 4).

    The message function is a perceptron with one hidden layer on the two states side by side. Its first layer is kept
    as two matrices, one for the source and one for the destination, so that a state is multiplied once however many
    edges it has.
    """

    def __init__(self, hidden_dim: int) -> None:
        super().__init__()
        self.source = nn.Linear(hidden_dim, hidden_dim)
        self.destination = nn.Linear(hidden_dim, hidden_dim, bias=False)
        self.output = nn.Linear(hidden_dim, hidden_dim)
        self.update = nn.GRUCell(hidden_dim, hidden_dim)

    def message(self, source: Float[Tensor, "... h"], destination: Float[Tensor, "... h"]) -> Float[Tensor, "... h"]:
        """Return the message from one node's state to another's; the reference implementation calls it too."""
        message: Tensor = self.output(torch.relu(self.source(source) + self.destination(destination)))
        return message

    def fused(self) -> "FusedLayer":
        """Return the same step with the fewest products, and with products of weights computed once."""
        source, update, hidden_dim = self.source, self.update, self.source.in_features
        gates = slice(0, 2 * hidden_dim)  # the GRU's rows are those of the reset gate, the keep gate and the candidate
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
    """The linear functions of a state that a step needs.

    Attributes:
        sent: ``[..., 4 h]``, its contributions as source and as destination of messages, and to the two gates.
        candidate: ``[..., h]``, its contribution to the GRU's candidate. A tensor of its own, since autograd keeps it
            and would keep all of ``sent`` with it.
    """

    sent: Tensor
    candidate: Tensor


@final
class FusedLayer(NamedTuple):
    """The joined weights of a :class:`MessageLayer`.

    Attributes:
        weight: ``[4 h, h]``, from a state to :attr:`Projection.sent`.
        bias: ``[4 h]``, the bias of that.
        candidate_weight: ``[h, h]``, from a state to :attr:`Projection.candidate`.
        candidate_bias: ``[h]``, the bias of that.
        received_weight: ``[3 h, h]``, from the summed inner layer of the messages to the gates and the candidate.
        received_bias: ``[3 h]``, the bias of that.
        message_bias: ``[3 h]``, what every message adds to gates and candidate.
    """

    weight: Tensor
    bias: Tensor
    candidate_weight: Tensor
    candidate_bias: Tensor
    received_weight: Tensor
    received_bias: Tensor
    message_bias: Tensor

    def to(self, dtype: torch.dtype) -> "FusedLayer":
        """Return the same weights in another precision."""
        return FusedLayer(*(weight.to(dtype) for weight in self))

    def project(self, states: Float[Tensor, "... h"]) -> Projection:
        """Return all linear functions of the states."""
        linear = nn.functional.linear
        return Projection(
            linear(states, self.weight, self.bias), linear(states, self.candidate_weight, self.candidate_bias)
        )

    def next_states(
        self, states: Float[Tensor, "k m h"], projected: Projection, edges: Sequence[tuple[int, int]]
    ) -> Float[Tensor, "k m h"]:
        """Return the next state of every node of the motif, for ``m`` instances at once.

        Args:
            states: of every node.
            projected: :meth:`project` of the states.
            edges: the motif's directed edges, in the order of their destinations.
        """
        hidden_dim, nodes = states.shape[-1], len(states)
        sources, destinations, gates = torch.split(projected.sent, [hidden_dim, hidden_dim, 2 * hidden_dim], dim=-1)
        senders, receivers = [i for i, _ in edges], [j for _, j in edges]
        # The output layer of a message and the GRU's input layer are both linear: messages are summed before them, with
        # the output layer's bias once per message, and the two layers are one product.
        sent = torch.stack([sources[i] for i in senders])  # copies whole rows; an index copies number by number
        if receivers == list(range(nodes)):  # one message per node
            inner = torch.relu(sent + destinations)
            received = nn.functional.linear(inner, self.received_weight, self.received_bias + self.message_bias)
        else:
            receiver_index = torch.tensor(receivers, device=states.device)
            inner = torch.relu(sent + destinations[receiver_index])
            summed = torch.zeros_like(states).index_add(0, receiver_index, inner)
            counts = receiver_index.bincount(minlength=nodes).to(states.dtype)[:, None, None]
            received = nn.functional.linear(summed, self.received_weight)
            received = received + (self.received_bias + counts * self.message_bias)
        reset, keep = torch.sigmoid(received[..., : 2 * hidden_dim] + gates).chunk(2, dim=-1)
        proposed = torch.tanh(torch.addcmul(received[..., 2 * hidden_dim :], reset, projected.candidate))
        return torch.lerp(proposed, states, keep)


@final
class MessagePassing(InstanceScorer):
    """``T`` steps of message passing, then a read-out of the final states.

    Args:
        motif: the motif of the instances.
        hidden_dim: ``h``.
        layers: ``T``.
        encoder_dim: width of the descriptors' encoder; None for a linear one.
        read_out: ``perceptron`` on the final states, as in the paper, or ``product`` of two of them.
        shared_weights: one set of weights for all steps, as in Gilmer et al., or one per step.
        prototypes: number of prototypes of a score by similarity to the demonstration (:class:`PrototypeMixture`),
            which is added to that of message passing; None for no such score. Messages let an unknown partner change
            the state of a known feature in ways that no demonstration has shown, but do not make it similar to one.
        cascade: K, the number of instances of a frame that get messages outside training: those with the best
            estimates, while all others keep the estimate (:mod:`geoskill.model.cascade`). None for all instances.
        precision: of the messages, ``float32`` or ``bfloat16``, which takes half the memory and is faster where the
            processor has products in it. Features are always encoded and compared with the demonstration in single
            precision: the similarity is an exponential of small differences.
        memory_mb: what training may keep of one batch for the backward pass, in MiB. For a batch that needs more,
            states are computed again, a chunk of instances at a time, so that memory no longer grows with their number.

    In training mode (``train()``) every instance gets messages, since nothing is learned from the others. In evaluation
    mode (``eval()``), K is the limit for all instances of one call: score larger frames one by one, since in a batch
    their instances would compete.

    Raises:
        InputError: when a size or ``memory_mb`` is not positive, or ``read_out`` or ``precision`` is unknown.
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
        sizes: dict[str, int | None] = {"hidden_dim": hidden_dim, "layers": layers, "encoder_dim": encoder_dim}
        for argument, value in (sizes | {"prototypes": prototypes, "cascade": cascade}).items():
            if value is not None and value < 1:
                raise InputError(f"{argument}={value}: expected at least 1")
        if memory_mb <= 0:
            raise InputError(f"memory_mb={memory_mb:g}: expected a positive number of MiB")
        self.motif = motif
        self.use_precision(precision)
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
        """Return the layer of a step, counted from 0."""
        layer = self.layers[step % len(self.layers)]
        assert isinstance(layer, MessageLayer)
        return layer

    def use_precision(self, precision: str) -> None:
        """Compute messages in this precision from now on; the weights stay as they are.

        Raises:
            InputError: when the precision is unknown.
        """
        if precision not in PRECISIONS:
            raise InputError(f"precision={precision}: expected {' or '.join(PRECISIONS)}")
        self.precision = precision

    def fit_prototypes(self, descriptors: Mapping[NodeType, Float[Tensor, "n _"]]) -> None:
        """Fit the prototypes, if there are any; see :meth:`PrototypeMixture.fit_prototypes`."""
        if self.prototype_score is not None:
            self.prototype_score.fit_prototypes(descriptors)

    def forward(
        self, descriptors: Mapping[NodeType, Float[Tensor, "n _"]], instance_index: Int64[Tensor, "k m"]
    ) -> Float[Tensor, " m"]:
        """Score instances; see :meth:`InstanceScorer.forward`. Messages are in the precision of ``torch.autocast``."""
        device = instance_index.device.type
        input_dtype = next(iter(descriptors.values())).dtype
        is_low = self.precision == "bfloat16" and input_dtype == torch.float32  # a network in double precision stays so
        dtype = torch.bfloat16 if is_low else input_dtype
        if torch.is_autocast_enabled(device):
            dtype = torch.get_autocast_dtype(device)
        with torch.autocast(device, enabled=False):
            return self._scores(descriptors, instance_index, dtype).to(input_dtype)

    def _scores(
        self,
        descriptors: Mapping[NodeType, Float[Tensor, "n _"]],
        instance_index: Int64[Tensor, "k m"],
        dtype: torch.dtype,
    ) -> Float[Tensor, " m"]:
        hidden = self.encoder(descriptors)
        fused = [layer.fused() for layer in map(self.layer, range(len(self.layers)))]
        if not torch.is_grad_enabled():  # with gradients in each chunk, so that they add up in single precision
            fused = [layer.to(dtype) for layer in fused]
            hidden = {node_type: states.to(dtype) for node_type, states in hidden.items()}
        # In the first step, a feature has the same state, and linear functions of it, in all of its instances.
        projected = {node_type: fused[0].project(states) for node_type, states in hidden.items()}
        state_bytes = dtype.itemsize * self.hidden_dim * len(self.motif.roles)
        message_scores: Score = partial(
            in_chunks,
            lambda index: self._message_scores(fused, hidden, projected, index, dtype),
            working_bytes=4 * state_bytes,
            saved_bytes=(SAVED_PER_STEP * self.steps + SAVED_BY_READ_OUT) * state_bytes,
            memory_bytes=MIB * self.memory_mb,
        )
        count = instance_index.shape[1]
        if self.prototype_score is None:
            similarity = next(iter(descriptors.values())).new_zeros(count)
        else:
            similarity = self.prototype_score(descriptors, instance_index)
        if self.cascade is None or self.training or count <= self.cascade:
            scores: Tensor = message_scores(instance_index) + similarity
            return scores
        counts = {node_type: len(rows) for node_type, rows in descriptors.items()}
        return cascade(similarity, message_scores, self.motif, counts, instance_index, self.cascade)

    def _message_scores(
        self,
        fused: Sequence[FusedLayer],
        hidden: Mapping[NodeType, Float[Tensor, "n h"]],
        projected: Mapping[NodeType, Projection],
        instance_index: Int64[Tensor, "k m"],
        dtype: torch.dtype,
    ) -> Float[Tensor, " m"]:
        """Return what message passing contributes to the scores of some instances."""
        fused = [layer.to(dtype) for layer in fused]

        def gather(rows: Mapping[NodeType, Tensor]) -> Tensor:
            index_by_role = zip(self.motif.roles, instance_index, strict=True)
            # Twice as fast as indexing, in both directions, and its gradient is summed in the same order in every run.
            return torch.stack([nn.functional.embedding(index, rows[role]) for role, index in index_by_role]).to(dtype)

        states = gather(hidden)
        first = Projection(
            gather({node_type: projection.sent for node_type, projection in projected.items()}),
            gather({node_type: projection.candidate for node_type, projection in projected.items()}),
        )
        for step in range(self.steps):
            layer = fused[step % len(fused)]
            states = layer.next_states(states, first if step == 0 else layer.project(states), self.edges)
        is_low = dtype in (torch.bfloat16, torch.float16)
        with torch.autocast(states.device.type, dtype if is_low else None, enabled=is_low):
            scores: Tensor = self.read_out(list(states))
        return scores
