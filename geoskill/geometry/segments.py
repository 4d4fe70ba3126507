"""Length, direction and midpoint of segments ``[x1, y1, x2, y2]``, which stand for the lines that carry them.

A segment has no carrier line when its end points coincide. Every function here stays finite in value and gradient
then, and says what it returns; shorter than :data:`DEGENERATE_LENGTH_PX` counts as coincident.
"""

from typing import Final

import torch
from jaxtyping import Bool, Float
from torch import Tensor

DEGENERATE_LENGTH_PX: Final = 1e-6
"""Below this length the direction of a segment is rounding noise."""


def length(segment: Float[Tensor, "m 4"]) -> Float[Tensor, " m"]:
    """Distance of the end points in pixels; 0 with a zero gradient where they coincide.

    >>> length(torch.tensor([[1.0, 1.0, 4.0, 5.0]]))
    tensor([5.])
    """
    distance: Tensor = torch.linalg.vector_norm(segment[:, 2:] - segment[:, :2], dim=1)
    return distance


def is_degenerate(segment: Float[Tensor, "m 4"]) -> Bool[Tensor, " m"]:
    """Whether the end points coincide, so that no carrier line exists."""
    return length(segment) < DEGENERATE_LENGTH_PX


def midpoint(segment: Float[Tensor, "m 4"]) -> Float[Tensor, "m 2"]:
    """The point halfway between the end points, in pixels.

    >>> midpoint(torch.tensor([[1.0, 1.0, 4.0, 5.0]]))
    tensor([[2.5000, 3.0000]])
    """
    return (segment[:, :2] + segment[:, 2:]) / 2


def reversed_ends(segment: Float[Tensor, "m 4"]) -> Float[Tensor, "m 4"]:
    """The same segments with their end points exchanged."""
    return torch.cat([segment[:, 2:], segment[:, :2]], dim=1)


def direction(segment: Float[Tensor, "m 4"]) -> Float[Tensor, "m 2"]:
    """Unit vector from the first end point to the second; (0, 0) with a zero gradient for a degenerate segment.

    >>> direction(torch.tensor([[1.0, 1.0, 4.0, 5.0], [7.0, 7.0, 7.0, 7.0]]))
    tensor([[0.6000, 0.8000],
            [0.0000, 0.0000]])
    """
    vector = segment[:, 2:] - segment[:, :2]
    degenerate = is_degenerate(segment)[:, None]
    # The divisor is replaced before dividing: masking the quotient afterward would leave NaN in its gradient.
    divisor = torch.where(degenerate, 1.0, length(segment)[:, None])
    return torch.where(degenerate, 0.0, vector / divisor)
