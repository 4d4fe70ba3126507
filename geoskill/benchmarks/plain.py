"""The network as one would write it with PyTorch Geometric: what ours is to be faster than."""

from collections.abc import Mapping
from typing import final

import torch
from jaxtyping import Float, Int64
from torch import Tensor, nn
from torch_geometric.data import Batch, Data

from geoskill.geometry.primitives import NodeType
from geoskill.model.message_passing import MessagePassing
from geoskill.model.reference import ReferenceLayer


def batch_of_instances(
    scorer: MessagePassing, descriptors: Mapping[NodeType, Float[Tensor, "n _"]], instance_index: Int64[Tensor, "k m"]
) -> Batch:
    """One small graph per instance, each with the descriptors of its own nodes; made once, as a data set would be."""
    edge_index = torch.tensor(scorer.motif.edges, device=instance_index.device).T
    roles = scorer.motif.roles
    graphs = [Data(edge_index=edge_index, num_nodes=len(roles)) for _ in range(instance_index.shape[1])]
    batch = Batch.from_data_list(graphs)
    for position, (role, row) in enumerate(zip(roles, instance_index, strict=True)):
        batch[f"descriptor_{position}"] = descriptors[role][row]
    return batch


@final
class PlainNetwork(nn.Module):
    """The network of a :class:`MessagePassing` over such a batch, with its weights.

    Args:
        scorer: whose weights; its direct score, if any, is computed of the same copies.
    """

    def __init__(self, scorer: MessagePassing) -> None:
        super().__init__()
        self.scorer = scorer

    def forward(self, batch: Batch) -> Float[Tensor, " m"]:
        """The score of every graph."""
        roles = self.scorer.motif.roles
        copies = [batch[f"descriptor_{position}"] for position in range(len(roles))]
        hidden = [self.scorer.encoder({role: rows})[role] for role, rows in zip(roles, copies, strict=True)]
        states = torch.stack(hidden, dim=1).flatten(0, 1)
        for step in range(self.scorer.steps):
            states = ReferenceLayer(self.scorer.layer(step))(states, batch.edge_index)
        of_graphs = states.reshape(-1, len(roles), states.shape[-1])
        scores: Tensor = self.scorer.read_out(list(of_graphs.unbind(dim=1)))
        if self.scorer.prototype_score is None:
            return scores
        count = len(scores)
        of_kind: dict[NodeType, list[Tensor]] = {}
        index = []
        for role, rows in zip(roles, copies, strict=True):
            index.append(torch.arange(count) + count * len(of_kind.setdefault(role, [])))
            of_kind[role].append(rows)
        joined = {role: torch.cat(rows) for role, rows in of_kind.items()}
        direct: Tensor = self.scorer.prototype_score(joined, torch.stack(index).to(scores.device))
        return scores + direct
