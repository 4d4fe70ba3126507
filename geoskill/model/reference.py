"""The message passing over the motif as one would write it with PyTorch Geometric: to be read and tested against.

Every instance is a small graph of its own here, so a feature is copied into each instance that it is part of. That is
what :class:`~geoskill.model.message_passing.MessagePassing` avoids; it must give the same scores.
"""

from collections.abc import Mapping
from typing import final

import torch
from jaxtyping import Float, Int64
from torch import Tensor
from torch_geometric.data import Batch, Data
from torch_geometric.nn import MessagePassing as GraphLayer

from geoskill.geometry.primitives import NodeType
from geoskill.model.message_passing import MessageLayer, MessagePassing


@final
class ReferenceLayer(GraphLayer):  # type: ignore[misc]  # PyTorch Geometric's classes have no types
    """One step of message passing with the weights of a :class:`MessageLayer`.

    Node j's state h_j, its new state, and the sum over its neighbors i (the paper's equations 2 to 4):
    ``h_j <- GRU(sum_i message(h_i, h_j), h_j)``.
    """

    def __init__(self, weights: MessageLayer) -> None:
        super().__init__(aggr="add", flow="source_to_target")
        self.weights = weights

    def forward(
        self, states: Float[Tensor, "nodes h"], edge_index: Int64[Tensor, "2 edges"]
    ) -> Float[Tensor, "nodes h"]:
        """The next state of every node of every graph."""
        messages = self.propagate(edge_index, x=states)
        updated: Tensor = self.weights.update(messages, states)
        return updated

    def message(self, x_j: Tensor, x_i: Tensor) -> Tensor:
        """The message along each edge; PyTorch Geometric calls the state of its source x_j, of its destination x_i."""
        return self.weights.message(source=x_j, destination=x_i)


def reference_scores(
    scorer: MessagePassing, descriptors: Mapping[NodeType, Float[Tensor, "n _"]], instance_index: Int64[Tensor, "k m"]
) -> Float[Tensor, " m"]:
    """What ``scorer(descriptors, instance_index)`` should return; gradients reach weights and descriptors alike."""
    motif = scorer.motif
    hidden = scorer.encoder(descriptors)
    edge_index = torch.tensor(motif.edges, device=instance_index.device).T
    graphs = [
        Data(
            x=torch.stack([hidden[role][feature] for role, feature in zip(motif.roles, instance, strict=True)]),
            edge_index=edge_index,
        )
        for instance in instance_index.T
    ]
    if not graphs:
        nothing: Tensor = hidden[motif.roles[0]].new_zeros(0)
        return nothing
    batch = Batch.from_data_list(graphs)

    states: Tensor = batch.x
    for step in range(scorer.steps):
        states = ReferenceLayer(scorer.layer(step))(states, batch.edge_index)

    # An instance at a time, and so the read-out is a part of what the dense path is compared with.
    of_instances = states.reshape(len(graphs), len(motif.roles), -1)
    scores = torch.cat([scorer.read_out([state[None] for state in instance]) for instance in of_instances])
    if scorer.prototype_score is None:
        return scores
    return scores + torch.cat([scorer.prototype_score(descriptors, instance[:, None]) for instance in instance_index.T])
