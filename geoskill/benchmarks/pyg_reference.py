"""The message-passing network written directly in PyTorch Geometric, as a reference for speed and correctness.

Every instance is a small graph of its own, so a feature is copied into each instance that contains it.
:class:`~geoskill.model.message_passing.MessagePassing` avoids these copies; it must return the same scores.
"""

from collections.abc import Mapping
from typing import final

import torch
from jaxtyping import Float, Int64
from torch import Tensor, nn
from torch_geometric.data import Batch, Data
from torch_geometric.nn import MessagePassing as GraphLayer

from geoskill.geometry.primitives import NodeType
from geoskill.model.message_passing import MessageLayer, MessagePassing
from geoskill.model.scorer import Motif


@final
class PygMessageLayer(GraphLayer):  # type: ignore[misc]  # PyTorch Geometric's classes have no types
    """One step of message passing with the weights of a :class:`MessageLayer`.

    Node j's state h_j is updated from the sum over its neighbors i (the paper's equations 2 to 4):
    ``h_j <- GRU(sum_i message(h_i, h_j), h_j)``.

    Args:
        weights: the layer whose weights are used; they are shared, not copied.
    """

    def __init__(self, weights: MessageLayer) -> None:
        super().__init__(aggr="add", flow="source_to_target")
        self.weights = weights

    def forward(
        self, states: Float[Tensor, "nodes h"], edge_index: Int64[Tensor, "2 edges"]
    ) -> Float[Tensor, "nodes h"]:
        """Return the next state of every node of every graph."""
        messages = self.propagate(edge_index, x=states)
        updated: Tensor = self.weights.update(messages, states)
        return updated

    def message(self, x_j: Tensor, x_i: Tensor) -> Tensor:
        """Return the message along each edge; ``x_j`` is the state of its source, ``x_i`` of its destination."""
        return self.weights.message(source=x_j, destination=x_i)


def instance_batch(
    motif: Motif, descriptors: Mapping[NodeType, Float[Tensor, "n _"]], instance_index: Int64[Tensor, "k m"]
) -> Batch:
    """Build a batch of one small graph per instance, with a copy of the descriptor of each of its nodes.

    Args:
        motif: node types and directed edges of every graph.
        descriptors: of the frame's features, by node type.
        instance_index: row ``r`` indexes the descriptors of the type of role ``r``; at least one instance.

    Returns:
        A batch with ``edge_index`` and, for each role ``r``, ``descriptor_r`` of shape ``[m, D_r]``.
    """
    edge_index = torch.tensor(motif.edges, device=instance_index.device).T
    graphs = [Data(edge_index=edge_index, num_nodes=len(motif.roles)) for _ in range(instance_index.shape[1])]
    batch = Batch.from_data_list(graphs)
    for position, (role, row) in enumerate(zip(motif.roles, instance_index, strict=True)):
        batch[f"descriptor_{position}"] = descriptors[role][row]
    return batch


@final
class PygNetwork(nn.Module):
    """The network of a :class:`MessagePassing`, with its weights, on batches of :func:`instance_batch`.

    Args:
        scorer: the network whose weights are used; they are shared, not copied. Its prototype score, if any, is
            computed on the copied descriptors.
    """

    def __init__(self, scorer: MessagePassing) -> None:
        super().__init__()
        self.scorer = scorer

    def forward(self, batch: Batch) -> Float[Tensor, " m"]:
        """Return the score of every graph."""
        roles = self.scorer.motif.roles
        copies = [batch[f"descriptor_{position}"] for position in range(len(roles))]
        hidden = [self.scorer.encoder({role: rows})[role] for role, rows in zip(roles, copies, strict=True)]
        states = torch.stack(hidden, dim=1).flatten(0, 1)
        for step in range(self.scorer.steps):
            states = PygMessageLayer(self.scorer.layer(step))(states, batch.edge_index)
        states_by_graph = states.reshape(-1, len(roles), states.shape[-1])
        scores: Tensor = self.scorer.read_out(list(states_by_graph.unbind(dim=1)))
        if self.scorer.prototype_score is None:
            return scores
        return scores + self._prototype_scores(copies)

    def _prototype_scores(self, copies: list[Float[Tensor, "m _"]]) -> Float[Tensor, " m"]:
        """Score the copies as if they were different features: those of one type are concatenated, role by role."""
        assert self.scorer.prototype_score is not None
        count = len(copies[0])
        copies_by_type: dict[NodeType, list[Tensor]] = {}
        index = []
        for role, rows in zip(self.scorer.motif.roles, copies, strict=True):
            index.append(torch.arange(count) + count * len(copies_by_type.setdefault(role, [])))
            copies_by_type[role].append(rows)
        descriptors = {role: torch.cat(rows) for role, rows in copies_by_type.items()}
        scores: Tensor = self.scorer.prototype_score(descriptors, torch.stack(index).to(copies[0].device))
        return scores


def reference_scores(
    scorer: MessagePassing, descriptors: Mapping[NodeType, Float[Tensor, "n _"]], instance_index: Int64[Tensor, "k m"]
) -> Float[Tensor, " m"]:
    """Return the scores that ``scorer(descriptors, instance_index)`` must equal, computed one instance at a time.

    No two instances meet in any operation, so encoder, read-out and prototype score are references too. Gradients
    reach weights and descriptors. Without instances the result is empty.
    """
    network = PygNetwork(scorer)
    scores = [network(instance_batch(scorer.motif, descriptors, instance[:, None])) for instance in instance_index.T]
    return torch.cat(scores) if scores else next(iter(descriptors.values())).new_zeros(0)
