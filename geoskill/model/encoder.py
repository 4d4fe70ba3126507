"""Encoders from descriptors to hidden states."""

from collections.abc import Mapping
from typing import final

import torch
from jaxtyping import Float
from torch import Tensor, nn

from geoskill.errors import InputError
from geoskill.geometry.primitives import NodeType
from geoskill.model.scorer import Motif

# Channels of the three convolutions over a patch; the second and the third halve its sides.
CHANNELS = (16, 32, 32)


@final
class DescriptorEncoder(nn.Module):
    """Encoders of descriptors, one per node type, into one space of hidden states.

    Every feature is encoded once, however many instances it is part of, so width costs little here. Patches of pixels
    are described by convolutions, which are trained with the kernel.

    Args:
        motif: gives the descriptor length of each node type, and the types whose descriptors begin with a patch.
        hidden_dim: length of the states.
        width: of the hidden layer of a perceptron; None for a linear encoder (design choice 5,
            docs/design-choices.md), which takes patches as plain numbers. A linear map into few states cannot separate
            the features that the task needs from those it has never seen; the perceptron can.

    Raises:
        InputError: when ``width`` is below 1.
    """

    def __init__(self, motif: Motif, hidden_dim: int, width: int | None = None) -> None:
        super().__init__()
        if width is not None and width < 1:
            raise InputError(f"width={width}: expected at least 1, or None for a linear encoder")

        def encoder(node_type: NodeType, dim: int) -> nn.Module:
            if width is None:
                return nn.Linear(dim, hidden_dim)
            side = motif.patch_sides.get(node_type)
            input_dim = dim if side is None else width + dim - side**2
            perceptron = nn.Sequential(nn.Linear(input_dim, width), nn.ReLU(), nn.Linear(width, hidden_dim))
            return perceptron if side is None else nn.Sequential(PatchDescription(side, width), perceptron)

        self.layers = nn.ModuleDict(
            {str(node_type): encoder(node_type, dim) for node_type, dim in motif.descriptor_dims.items()}
        )

    def forward(self, descriptors: Mapping[NodeType, Float[Tensor, "n _"]]) -> dict[NodeType, Float[Tensor, "n h"]]:
        """Return the hidden state of every feature."""
        # Unit-norm descriptors have components of about 1/sqrt(D); a linear layer wants them of about 1.
        return {node_type: self.layers[str(node_type)](x * x.shape[1] ** 0.5) for node_type, x in descriptors.items()}


@final
class PatchDescription(nn.Module):
    """A convolutional network that replaces the patch at the beginning of a descriptor by a learned description.

    Args:
        side: of the patch, in pixels; a multiple of four.
        width: length of the description.

    Raises:
        ValueError: when ``side`` is not a multiple of four.
    """

    def __init__(self, side: int, width: int) -> None:
        super().__init__()
        if side % 4 != 0:
            raise ValueError(f"side={side}: expected a multiple of four pixels")
        first, second, third = CHANNELS
        self.side = side
        self.network = nn.Sequential(
            nn.Conv2d(1, first, 3, padding=1),
            nn.ReLU(),
            nn.Conv2d(first, second, 3, stride=2, padding=1),
            nn.ReLU(),
            nn.Conv2d(second, third, 3, stride=2, padding=1),
            nn.ReLU(),
            nn.Flatten(),
            nn.Linear(third * (side // 4) ** 2, width),
        )

    def forward(self, descriptors: Float[Tensor, "n d"]) -> Float[Tensor, "n e"]:
        """Return the description of the patch, followed by the rest of the descriptor unchanged."""
        patch, rest = descriptors[:, : self.side**2], descriptors[:, self.side**2 :]
        return torch.cat([self.network(patch.reshape(-1, 1, self.side, self.side)), rest], dim=1)
