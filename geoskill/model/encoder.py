"""From descriptors to hidden states."""

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
    """One encoder per node type, so that a point's 128 numbers and a line's 72 meet in one space.

    Every feature is encoded once, however many instances it is part of, so width costs little here. Patches of pixels
    are described by convolutions, which are trained with the kernel.

    Args:
        motif: says how long the descriptors of each node type are, and which of them are patches.
        hidden_dim: length of the states.
        width: of the hidden layer of a perceptron; None for a linear encoder (METHOD #5), of patches too. A linear map
            into few states cannot keep apart the features that the task needs and those it has never seen; the
            perceptron can.

    Raises:
        InputError: when ``width`` is below 1.
    """

    def __init__(self, motif: Motif, hidden_dim: int, width: int | None = None) -> None:
        super().__init__()
        if width is not None and width < 1:
            raise InputError(f"model.encoder_dim={width}: expected at least 1, or null for a linear encoder")

        def encoder(kind: NodeType, dim: int) -> nn.Module:
            if width is None:
                return nn.Linear(dim, hidden_dim)
            side = motif.patch_sides.get(kind)
            described = dim if side is None else width + dim - side**2
            perceptron = nn.Sequential(nn.Linear(described, width), nn.ReLU(), nn.Linear(width, hidden_dim))
            return perceptron if side is None else nn.Sequential(PatchDescription(side, width), perceptron)

        self.layers = nn.ModuleDict({str(kind): encoder(kind, dim) for kind, dim in motif.descriptor_dims.items()})

    def forward(self, descriptors: Mapping[NodeType, Float[Tensor, "n _"]]) -> dict[NodeType, Float[Tensor, "n h"]]:
        """Hidden states of every feature."""
        # Unit-norm descriptors have components of about 1/sqrt(D); a linear layer wants them of about 1.
        return {kind: self.layers[str(kind)](x * x.shape[1] ** 0.5) for kind, x in descriptors.items()}


@final
class PatchDescription(nn.Module):
    """Puts a learned description in place of the patch with which a descriptor begins.

    Args:
        side: of the patch, in pixels; a multiple of four.
        width: length of the description.

    Raises:
        ValueError: when it is not.
    """

    def __init__(self, side: int, width: int) -> None:
        super().__init__()
        if side % 4 != 0:
            raise ValueError(f"patches of {side} pixels; expected a multiple of four")
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
        """The description of the patch, and what stands beside it as it is."""
        patch, beside = descriptors[:, : self.side**2], descriptors[:, self.side**2 :]
        return torch.cat([self.network(patch.reshape(-1, 1, self.side, self.side)), beside], dim=1)
