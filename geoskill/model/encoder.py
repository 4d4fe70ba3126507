"""From descriptors to hidden states."""

from collections.abc import Mapping
from typing import final

from jaxtyping import Float
from torch import Tensor, nn

from geoskill.errors import InputError
from geoskill.geometry.primitives import NodeType


@final
class DescriptorEncoder(nn.Module):
    """One encoder per node type, so that a point's 128 numbers and a line's 72 meet in one space.

    Every feature is encoded once, however many instances it is part of, so width costs little here.

    Args:
        descriptor_dims: length of the descriptors of each node type.
        hidden_dim: length of the states.
        width: of the hidden layer of a perceptron; None for a linear encoder (METHOD #5). A linear map into few states
            cannot keep apart the features that the task needs and those it has never seen; the perceptron can.

    Raises:
        InputError: when ``width`` is below 1.
    """

    def __init__(self, descriptor_dims: Mapping[NodeType, int], hidden_dim: int, width: int | None = None) -> None:
        super().__init__()
        if width is not None and width < 1:
            raise InputError(f"model.encoder_dim={width}: expected at least 1, or null for a linear encoder")

        def encoder(dim: int) -> nn.Module:
            if width is None:
                return nn.Linear(dim, hidden_dim)
            return nn.Sequential(nn.Linear(dim, width), nn.ReLU(), nn.Linear(width, hidden_dim))

        self.layers = nn.ModuleDict({str(kind): encoder(dim) for kind, dim in descriptor_dims.items()})

    def forward(self, descriptors: Mapping[NodeType, Float[Tensor, "n _"]]) -> dict[NodeType, Float[Tensor, "n h"]]:
        """Hidden states of every feature."""
        # Unit-norm descriptors have components of about 1/sqrt(D); a linear layer wants them of about 1.
        return {kind: self.layers[str(kind)](x * x.shape[1] ** 0.5) for kind, x in descriptors.items()}
