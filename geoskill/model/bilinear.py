"""A factorized select-out: features are encoded one by one, and instances scored by inner products."""

from collections.abc import Mapping
from typing import ClassVar, final

import torch
from jaxtyping import Float, Int64
from torch import Tensor, nn

from geoskill.errors import InputError
from geoskill.geometry.primitives import NodeType
from geoskill.model.encoder import DescriptorEncoder
from geoskill.model.scorer import InstanceScorer, Motif


@final
class Bilinear(InstanceScorer):
    """A scorer that sums ``u(f_i) . v(f_j)`` over the directed edges of the motif, with two encoders u and v.

    Summing over both directions of every edge makes the score symmetric under the motif's automorphisms. Apart from the
    inner products, the cost is linear in the number of features, which makes this the choice for many features.

    Args:
        motif: the motif of the instances.
        hidden_dim: width of the encoders and of the inner product.

    Raises:
        InputError: when ``hidden_dim`` is below 1.
    """

    name: ClassVar[str] = "bilinear"

    def __init__(self, motif: Motif, *, hidden_dim: int) -> None:
        super().__init__()
        if hidden_dim < 1:
            raise InputError(f"hidden_dim={hidden_dim}: expected at least 1")
        self.motif = motif
        self.scale = hidden_dim**-0.5
        self.source: nn.Module = DescriptorEncoder(motif, hidden_dim, hidden_dim)
        self.destination: nn.Module = DescriptorEncoder(motif, hidden_dim, hidden_dim)

    def forward(
        self, descriptors: Mapping[NodeType, Float[Tensor, "n _"]], instance_index: Int64[Tensor, "k m"]
    ) -> Float[Tensor, " m"]:
        """Score instances; see :meth:`InstanceScorer.forward`."""
        source, destination = self.source(descriptors), self.destination(descriptors)
        roles = self.motif.roles
        terms = [
            (source[roles[i]][instance_index[i]] * destination[roles[j]][instance_index[j]]).sum(dim=1)
            for i, j in self.motif.edges
        ]
        total: Tensor = torch.stack(terms).sum(dim=0) * self.scale
        return total
