"""Length, direction, midpoint and distance of segments ``[x1, y1, x2, y2]``, which stand for their carrier lines.

A segment shorter than :data:`DEGENERATE_LENGTH_PX` is degenerate: its end points count as coincident, and it has no
carrier line. Every function stays finite in value and gradient on such segments, and states what it returns.
"""

from typing import Final

import numpy as np
import torch
from jaxtyping import Bool, Float
from torch import Tensor

DEGENERATE_LENGTH_PX: Final = 1e-6
"""Below this length the direction of a segment is rounding noise."""


def length(segment: Float[Tensor, "m 4"]) -> Float[Tensor, " m"]:
    """Return the distance between the end points in pixels; 0 with a zero gradient where they coincide.

    >>> length(torch.tensor([[1.0, 1.0, 4.0, 5.0]]))
    tensor([5.])
    """
    distance: Tensor = torch.linalg.vector_norm(segment[:, 2:] - segment[:, :2], dim=1)
    return distance


def is_degenerate(segment: Float[Tensor, "m 4"]) -> Bool[Tensor, " m"]:
    """Return whether the end points coincide, so that no carrier line exists."""
    return length(segment) < DEGENERATE_LENGTH_PX


def midpoint(segment: Float[Tensor, "m 4"]) -> Float[Tensor, "m 2"]:
    """Return the point halfway between the end points, in pixels.

    >>> midpoint(torch.tensor([[1.0, 1.0, 4.0, 5.0]]))
    tensor([[2.5000, 3.0000]])
    """
    return (segment[:, :2] + segment[:, 2:]) / 2


def reversed_ends(segment: Float[Tensor, "m 4"]) -> Float[Tensor, "m 4"]:
    """Return the segments with their end points exchanged."""
    return torch.cat([segment[:, 2:], segment[:, :2]], dim=1)


def directed(segment: Float[Tensor, "m 4"], axis: Float[Tensor, "#m 2"]) -> Float[Tensor, "m 4"]:
    """Return the segments with their end points in the order that makes the product of direction and axis positive.

    The result does not depend on the order of the given end points. A segment at right angles to the axis points to
    the axis's right, as seen on the screen; one whose end points coincide stays as it is.

    >>> directed(torch.tensor([[5.0, 1.0, 2.0, 1.0], [4.0, 7.0, 4.0, 3.0]]), torch.tensor([[1.0, 0.0]]))
    tensor([[2., 1., 5., 1.],
            [4., 3., 4., 7.]])
    """
    vector = segment[:, 2:] - segment[:, :2]
    along = (vector * axis).sum(dim=1)
    across = axis[:, 0] * vector[:, 1] - axis[:, 1] * vector[:, 0]
    against = torch.where(along == 0, across, along) < 0
    return torch.where(against[:, None], reversed_ends(segment), segment)


def turned(
    axis: Float[Tensor, "m 2"], before: Float[Tensor, "m 4"], after: Float[Tensor, "m 4"]
) -> Float[Tensor, "m 2"]:
    """Return axes turned by the angle between two segments each, the smaller one of the two that lines have.

    They stay as they are where a segment is degenerate.

    >>> turned(torch.tensor([[1.0, 0.0]]), torch.tensor([[0.0, 0.0, 2.0, 0.0]]), torch.tensor([[0.0, 0.0, -3.0, -3.0]]))
    tensor([[0.7071, 0.7071]])
    """
    first, second = direction(before).T, direction(after).T
    cosine, sine = (first * second).sum(dim=0), first[0] * second[1] - first[1] * second[0]
    sign = torch.where(cosine < 0, -1.0, 1.0)
    cosine, sine = sign * cosine, sign * sine
    rotated = torch.stack([cosine * axis[:, 0] - sine * axis[:, 1], sine * axis[:, 0] + cosine * axis[:, 1]], dim=1)
    unknown = is_degenerate(before) | is_degenerate(after)
    return torch.where(unknown[:, None], axis, rotated)


def direction(segment: Float[Tensor, "m 4"]) -> Float[Tensor, "m 2"]:
    """Return the unit vector from the first end point to the second.

    A degenerate segment has (0, 0), with a zero gradient.

    >>> direction(torch.tensor([[1.0, 1.0, 4.0, 5.0], [7.0, 7.0, 7.0, 7.0]]))
    tensor([[0.6000, 0.8000],
            [0.0000, 0.0000]])
    """
    vector = segment[:, 2:] - segment[:, :2]
    degenerate = is_degenerate(segment)[:, None]
    # Replaced before the division: masking the quotient would leave NaN in its gradient.
    divisor = torch.where(degenerate, 1.0, length(segment)[:, None])
    return torch.where(degenerate, 0.0, vector / divisor)


def distance_to_segment(
    points: Float[np.ndarray, "*#batch 2"], segments: Float[np.ndarray, "*#batch 4"]
) -> Float[np.ndarray, "..."]:
    """Return the distance in pixels from points to segments (NumPy), not to their carrier lines.

    Args:
        points: x and y; broadcast against ``segments``.
        segments: a degenerate segment is the point that its end points share.

    >>> distance_to_segment(np.array([[9.0, 4.0], [5.0, 4.0]]), np.array([[0.0, 0.0, 6.0, 0.0]]))
    array([5., 4.])
    """
    start, end = segments[..., :2], segments[..., 2:]
    along = end - start
    length_squared = np.maximum((along**2).sum(axis=-1), 1e-12)
    fraction = np.minimum(np.maximum(((points - start) * along).sum(axis=-1) / length_squared, 0.0), 1.0)
    offset = points - (start + fraction[..., None] * along)
    distance: np.ndarray = np.sqrt((offset**2).sum(axis=-1))
    return distance
