"""From descriptors to hidden states."""

from collections.abc import Mapping
from typing import final

from jaxtyping import Float
from torch import Tensor, nn

from geoskill.geometry.primitives import NodeType


@final
class DescriptorEncoder(nn.Module):
    """One linear layer per node type, so that a point's 128 numbers and a line's 72 meet in one space."""

    def __init__(self, descriptor_dims: Mapping[NodeType, int], hidden_dim: int) -> None:
        super().__init__()
        self.layers = nn.ModuleDict({str(kind): nn.Linear(dim, hidden_dim) for kind, dim in descriptor_dims.items()})

    def forward(self, descriptors: Mapping[NodeType, Float[Tensor, "n _"]]) -> dict[NodeType, Float[Tensor, "n h"]]:
        """Hidden states of every feature; each feature is encoded once, however many instances it is part of."""
        # Unit-norm descriptors have components of about 1/sqrt(D); a linear layer wants them of about 1.
        return {kind: self.layers[str(kind)](x * x.shape[1] ** 0.5) for kind, x in descriptors.items()}
