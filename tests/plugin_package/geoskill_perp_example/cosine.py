"""A network that compares the features of an instance by the cosine of their encodings."""

from collections.abc import Mapping
from typing import ClassVar, final

import torch
from jaxtyping import Float, Int64
from torch import Tensor, nn

from geoskill.geometry.primitives import NodeType
from geoskill.model.scorer import InstanceScorer, Motif

WIDTH = 16


@final
class Cosine(InstanceScorer):
    """The sum of cosines over the motif's edges, in both directions, hence the same for every automorphism.

    Args:
        motif: what an instance looks like.
        temperature: the score is the sum divided by it.
    """

    name: ClassVar[str] = "cosine"

    def __init__(self, motif: Motif, temperature: float = 0.1) -> None:
        super().__init__()
        self.motif = motif
        self.temperature = temperature
        self.source = nn.ModuleDict({str(kind): nn.Linear(dim, WIDTH) for kind, dim in motif.descriptor_dims.items()})
        self.target = nn.ModuleDict({str(kind): nn.Linear(dim, WIDTH) for kind, dim in motif.descriptor_dims.items()})

    def forward(
        self, descriptors: Mapping[NodeType, Float[Tensor, "n _"]], instance_index: Int64[Tensor, "k m"]
    ) -> Float[Tensor, " m"]:
        """See :meth:`InstanceScorer.forward`."""
        source = {kind: self.source[str(kind)](rows) for kind, rows in descriptors.items()}
        target = {kind: self.target[str(kind)](rows) for kind, rows in descriptors.items()}
        roles = self.motif.roles
        cosines = [
            torch.cosine_similarity(source[roles[i]][instance_index[i]], target[roles[j]][instance_index[j]], dim=1)
            for i, j in self.motif.edges
        ]
        return torch.stack(cosines).sum(dim=0) / self.temperature
