"""Control errors of primitives in space: zero exactly where the geometric constraint holds.

Points are ``[m, 3]``, lines the segments ``[m, 6]`` between two points, planes ``[m, 4]`` with ``[n, d]`` for
n·X + d = 0 and n of unit length; all in meters, in the camera's frame (x right, y down, z forward). A segment stands
for its carrier line and is degenerate below :data:`DEGENERATE_LENGTH_M`. All values and gradients are finite.
Source: docs/method.md, Constraints in space; coplanarity after Jin et al., ICRA 2020, section III-A.
"""

import math
from itertools import combinations
from typing import Final

import torch
from jaxtyping import Bool, Float
from torch import Tensor

DEGENERATE_LENGTH_M: Final = 1e-6
"""Below this length the direction of a segment is rounding noise."""
DEGENERATE_AREA_M2: Final = 25e-6
"""Three points that span less than this have no plane: noise of depth turns it by tens of degrees."""
PARALLEL_SINE: Final = math.sin(math.radians(3.0))
"""Below about this sine of their angle, two lines count as parallel."""


def point_to_point_in_space(x: Float[Tensor, "m 3"], y: Float[Tensor, "m 3"]) -> Float[Tensor, "m 3"]:
    """Return the error of coincidence, x - y in meters; swapping the points flips the sign.

    >>> point_to_point_in_space(torch.tensor([[0.1, 0.0, 0.7]]), torch.tensor([[0.0, 0.0, 0.5]])).round(decimals=3)
    tensor([[0.1000, 0.0000, 0.2000]])
    """
    return x - y


def point_to_line_in_space(x: Float[Tensor, "m 3"], segment: Float[Tensor, "m 6"]) -> Float[Tensor, "m 3"]:
    """Return the offset in meters from the nearest point of the segment's carrier line to x, of rank 2.

    It does not depend on the order of the segment's ends. Zero exactly when x is on the carrier, also beyond the ends.
    Degenerate segment: the offset from its midpoint.

    >>> segment = torch.tensor([[0.0, 0.0, 1.0, 2.0, 0.0, 1.0]])
    >>> point_to_line_in_space(torch.tensor([[5.0, 3.0, 0.0]]), segment)
    tensor([[ 0.,  3., -1.]])
    """
    along, offset = direction_in_space(segment), x - middle_in_space(segment)
    return offset - (offset * along).sum(dim=1, keepdim=True) * along


def line_to_line_in_space(first: Float[Tensor, "m 6"], second: Float[Tensor, "m 6"]) -> Float[Tensor, "m 6"]:
    """Return the error of collinearity: offsets in meters between the lines at two places, of rank 4.

    With u the unit vector halfway between the directions (the acute angle of the two), c the mean of the midpoints and
    L the mean half length, a± and b± are the points of the lines in the planes u·(X - c) = ±L::

        E = [a+ - b+, a- - b-] / sqrt 2

    Parallel lines at distance h have an error of norm h. Swapping the lines flips the sign, and exchanges the halves of
    lines that point against each other; exchanging the ends of the first exchanges the halves, exchanging those of the
    second changes nothing. At 90° the vector, and there alone the
    norm, depends on the order of the ends. Either segment degenerate: both halves are the difference of the midpoints
    over sqrt 2.

    Parallel at 0.3 m, then crossing at right angles in their midpoints:

    >>> first = torch.tensor([[-1.0, 0.0, 0.0, 1.0, 0.0, 0.0]])
    >>> line_to_line_in_space(first, torch.tensor([[1.0, 0.3, 0.0, -1.0, 0.3, 0.0]])).norm()
    tensor(0.3000)
    >>> line_to_line_in_space(first, torch.tensor([[0.0, -1.0, 0.0, 0.0, 1.0, 0.0]])).norm().round(decimals=4)
    tensor(2.)
    """
    u_first, u_second = direction_in_space(first), direction_in_space(second)
    middle_first, middle_second = middle_in_space(first), middle_in_space(second)
    degenerate = (is_degenerate_in_space(first) | is_degenerate_in_space(second))[:, None]
    sign = torch.where((u_first * u_second).sum(dim=1, keepdim=True) < 0, -1.0, 1.0)
    halfway = u_first + sign * u_second
    # Where a segment has no direction, any other will do: the result is not used.
    safe = torch.where(degenerate, torch.ones_like(halfway), halfway)
    axis = safe / torch.linalg.vector_norm(safe, dim=1, keepdim=True)
    center = (middle_first + middle_second) / 2
    half_length = (length_in_space(first) + length_in_space(second))[:, None] / 4

    def at(middle: Tensor, along: Tensor, place: Tensor) -> Tensor:
        cosine = (axis * along).sum(dim=1, keepdim=True)
        cosine = torch.where(degenerate, torch.ones_like(cosine), cosine)
        reach = (place - (axis * (middle - center)).sum(dim=1, keepdim=True)) / cosine
        place_on_line: Tensor = middle + reach * along
        return place_on_line

    halves = [
        at(middle_first, u_first, place) - at(middle_second, u_second, place) for place in (half_length, -half_length)
    ]
    between = middle_first - middle_second
    halves = [torch.where(degenerate, between, half) for half in halves]
    return torch.cat(halves, dim=1) / math.sqrt(2.0)


def parallel_in_space(first: Float[Tensor, "m 6"], second: Float[Tensor, "m 6"]) -> Float[Tensor, "m 3"]:
    """Return the error of parallelism: the cross product of the unit directions, without unit, of rank 2.

    Its norm is the sine of the angle. Swapping the lines, or exchanging the ends of one, flips the sign.
    Degenerate segment: (1, 0, 0), the largest error, since it has no direction.

    >>> first, second = torch.tensor([[0.0, 0.0, 1.0, 2.0, 0.0, 1.0]]), torch.tensor([[0.0, 0.0, 1.0, 3.0, 4.0, 1.0]])
    >>> parallel_in_space(first, second)
    tensor([[0.0000, 0.0000, 0.8000]])
    """
    cross = torch.linalg.cross(direction_in_space(first), direction_in_space(second), dim=1)
    degenerate = (is_degenerate_in_space(first) | is_degenerate_in_space(second))[:, None]
    return torch.where(degenerate, torch.eye(3, dtype=cross.dtype, device=cross.device)[0], cross)


def point_to_plane(x: Float[Tensor, "m 3"], plane: Float[Tensor, "m 4"]) -> Float[Tensor, "m 1"]:
    """Return the signed distance n·X + d in meters, positive on the side that n points to.

    >>> point_to_plane(torch.tensor([[0.0, 0.0, 0.6]]), torch.tensor([[0.0, 0.0, -1.0, 0.7]])).round(decimals=3)
    tensor([[0.1000]])
    """
    distance: Tensor = (plane[:, :3] * x).sum(dim=1, keepdim=True) + plane[:, 3:]
    return distance


def coplanarity(points: Float[Tensor, "4 m 3"]) -> Float[Tensor, "m 1"]:
    """Return by how many meters four points miss a common plane: the smallest of their distances to it.

    With the area of the largest of the four triangles,

        E = det[X2 - X1, X3 - X1, X4 - X1] / (2 area),

    the distance of the fourth point to that triangle's plane. An even permutation of the points keeps it, an odd one
    flips the sign. Four points within one line, or of one place, have no plane and never satisfy the constraint: where
    the area is below :data:`DEGENERATE_AREA_M2`, the largest distance of two of them.

    Three points in the plane z = 1, and one 0.25 m farther away:

    >>> points = torch.tensor([[[0.0, 0.0, 1.0]], [[1.0, 0.0, 1.0]], [[0.0, 1.0, 1.0]], [[0.4, 0.4, 1.25]]])
    >>> coplanarity(points)
    tensor([[0.2500]])
    """
    edges = points[1:] - points[0]
    determinant = (edges[0] * torch.linalg.cross(edges[1], edges[2], dim=1)).sum(dim=1)
    normals = torch.stack(
        [
            torch.linalg.cross(points[j] - points[i], points[k] - points[i], dim=1)
            for i, j, k in combinations(range(4), 3)
        ]
    )
    squared = normals.square().sum(dim=2).amax(dim=0)  # of twice the area
    degenerate = squared < (2 * DEGENERATE_AREA_M2) ** 2
    twice_area = torch.where(degenerate, torch.ones_like(squared), squared).sqrt()
    spread = torch.stack(
        [torch.linalg.vector_norm(points[i] - points[j], dim=1) for i, j in combinations(range(4), 2)]
    ).amax(dim=0)
    return torch.where(degenerate, spread, determinant / twice_area)[:, None]


def lines_coplanarity(first: Float[Tensor, "m 6"], second: Float[Tensor, "m 6"]) -> Float[Tensor, "m 1"]:
    """Return by how many meters two lines miss a common plane: the distance of the carriers, but 0 where parallel.

    With w = u_first x u_second, E = (m_second - m_first)·w / sqrt(norm(w)² + sin² 3°): for lines at more than some
    degrees the distance of the carriers, and 0 for parallel ones, which are coplanar. Swapping the lines keeps it,
    exchanging the ends of one flips the sign. Degenerate segment: the distance of the midpoints.

    >>> first, second = torch.tensor([[-1.0, 0.0, 1.0, 1.0, 0.0, 1.0]]), torch.tensor([[0.0, -1.0, 1.5, 0.0, 1.0, 1.5]])
    >>> lines_coplanarity(first, second).round(decimals=3)
    tensor([[0.4990]])
    """
    cross = torch.linalg.cross(direction_in_space(first), direction_in_space(second), dim=1)
    between = middle_in_space(second) - middle_in_space(first)
    error = (between * cross).sum(dim=1) / (cross.square().sum(dim=1) + PARALLEL_SINE**2).sqrt()
    degenerate = is_degenerate_in_space(first) | is_degenerate_in_space(second)
    return torch.where(degenerate, torch.linalg.vector_norm(between, dim=1), error)[:, None]


def length_in_space(segment: Float[Tensor, "m 6"]) -> Float[Tensor, " m"]:
    """Return the distance between the ends in meters."""
    distance: Tensor = torch.linalg.vector_norm(segment[:, 3:] - segment[:, :3], dim=1)
    return distance


def is_degenerate_in_space(segment: Float[Tensor, "m 6"]) -> Bool[Tensor, " m"]:
    """Return whether the ends coincide, so that no carrier line exists."""
    return length_in_space(segment) < DEGENERATE_LENGTH_M


def middle_in_space(segment: Float[Tensor, "m 6"]) -> Float[Tensor, "m 3"]:
    """Return the point halfway between the ends, in meters."""
    return (segment[:, :3] + segment[:, 3:]) / 2


def direction_in_space(segment: Float[Tensor, "m 6"]) -> Float[Tensor, "m 3"]:
    """Return the unit vector from the first end to the second; zero, with a zero gradient, where degenerate."""
    vector = segment[:, 3:] - segment[:, :3]
    degenerate = is_degenerate_in_space(segment)[:, None]
    # Replaced before the division: masking the quotient would leave NaN in its gradient.
    divisor = torch.where(degenerate, 1.0, length_in_space(segment)[:, None])
    return torch.where(degenerate, 0.0, vector / divisor)
