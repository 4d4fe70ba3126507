"""Control errors of pairs of image primitives: zero exactly where the geometric constraint holds.

Points are ``[m, 2]`` and segments ``[m, 4]`` in pixels (x right, y down). A segment stands for its carrier line. A
degenerate segment (coinciding end points) has no carrier line and never satisfies a constraint on a line: it is treated
as a point, as stated in each function. All values and gradients are finite.
Source: docs/method.md, Control errors; Jin et al., ICRA 2020, section III-A.
"""

import torch
from jaxtyping import Float
from torch import Tensor

from geoskill.geometry.segments import direction, is_degenerate, midpoint, reversed_ends


def error_norm(errors: Float[Tensor, "m d"]) -> Float[Tensor, " m"]:
    """Return the Euclidean norm of each control error, in the unit of the error; its gradient at zero is zero.

    >>> error_norm(torch.tensor([[3.0, -4.0], [0.0, 0.0]]))
    tensor([5., 0.])
    """
    norm: Tensor = torch.linalg.vector_norm(errors, dim=1)
    return norm


def point_to_point(x: Float[Tensor, "m 2"], y: Float[Tensor, "m 2"]) -> Float[Tensor, "m 2"]:
    """Return the error of coincidence, x - y in pixels: zero exactly when the points coincide.

    Swapping the points flips the sign.

    >>> point_to_point(torch.tensor([[101.5, 66.0]]), torch.tensor([[75.5, 141.0]]))
    tensor([[ 26., -75.]])
    """
    return x - y


def point_to_line(x: Float[Tensor, "m 2"], segment: Float[Tensor, "m 4"]) -> Float[Tensor, "m 1"]:
    """Return the signed distance in pixels of x to the segment's carrier line.

    Equal to lᵀx / (x₃ norm(l₁₂)) for the homogeneous line l and point x, so invariant to their scale except for the
    sign of l. Positive to the right of the direction from the first end point to the second, as seen on the screen;
    exchanging the end points flips the sign. Zero exactly when x is on the carrier, also beyond the segment's ends.
    Degenerate segment: the (non-negative) distance from x to that point.

    >>> segment = torch.tensor([[0.0, 3.0, 5.0, 3.0]])
    >>> point_to_line(torch.tensor([[9.0, 7.0]]), segment), point_to_line(torch.tensor([[9.0, 1.0]]), segment)
    (tensor([[4.]]), tensor([[-2.]]))
    """
    # Not lᵀx: products of absolute coordinates would cost float32 three digits.
    offset = x - segment[:, :2]
    signed = _cross(direction(segment), offset)
    return torch.where(is_degenerate(segment), error_norm(offset), signed)[:, None]


def line_to_line(first: Float[Tensor, "m 4"], second: Float[Tensor, "m 4"]) -> Float[Tensor, "m 2"]:
    """Return the error of collinearity: two signed distances in pixels, zero exactly when both share one carrier.

    The second segment is first turned so that it does not point against the first. Let e_k be the distance of its k-th
    end point to the first carrier (:func:`point_to_line`), and f_k the distance of the first segment's k-th end point
    to the second carrier. Parallel lines lie on opposite sides of each other, so the symmetric mean is

        E_k = (e_k - f_k) / 2.

    The plain mean (e_k + f_k) / 2 would vanish on all parallel lines of the same direction. E alone would be
    discontinuous: its length jumps where the angle passes 90° and the second segment is turned. The error is therefore

        E · sqrt(norm(E)² + sin²(angle) norm(D)²) / norm(E),    D_k = (e_k + f_k) / 2.

    At 90° its norm is the root of (norm(e)² + norm(f)²) / 2, whichever direction the second segment has. Near
    collinearity it agrees with E to third order, so the image Jacobian there is the one of E.

    The norm is continuous, and unchanged by swapping the lines or exchanging the end points of either. For parallel
    lines at distance h the error is (±h, ±h), positive when the second is to the right of the first. Exchanging the end
    points of the second leaves the vector unchanged; exchanging those of the first turns (E₁, E₂) into (-E₂, -E₁).
    Swapping the lines turns it into (-E₁, -E₂) when the given segments form an angle below 90°, else into (E₂, E₁). At
    exactly 90° the vector depends on the order of the second's end points; the norm does not.
    Degenerate segment, either or both: both components are the distance between the midpoints.

    Two parallel lines 4 px apart, the second drawn backwards; then two lines, 10 px long, that cross at 90°:

    >>> line_to_line(torch.tensor([[0.0, 0.0, 10.0, 0.0]]), torch.tensor([[30.0, 4.0, 20.0, 4.0]]))
    tensor([[4., 4.]])
    >>> line_to_line(torch.tensor([[-5.0, 0.0, 5.0, 0.0]]), torch.tensor([[0.0, -5.0, 0.0, 5.0]]))
    tensor([[-5.,  5.]])
    """
    against = (direction(first) * direction(second)).sum(dim=1, keepdim=True) < 0
    second = torch.where(against, reversed_ends(second), second)
    second_to_first = _end_points_to_line(second, first)
    first_to_second = _end_points_to_line(first, second)
    symmetric = (second_to_first - first_to_second) / 2
    remainder = (second_to_first + first_to_second) / 2
    sine = _cross(direction(first), direction(second))

    size_squared = symmetric.square().sum(dim=1)
    collinear = size_squared == 0
    excess = (sine.square() * remainder.square().sum(dim=1)) / torch.where(collinear, 1.0, size_squared)
    error = symmetric * torch.where(collinear, 1.0, torch.sqrt(1 + excess))[:, None]

    degenerate = (is_degenerate(first) | is_degenerate(second))[:, None]
    between_midpoints = error_norm(midpoint(first) - midpoint(second))[:, None].expand(-1, 2)
    return torch.where(degenerate, between_midpoints, error)


def parallel(first: Float[Tensor, "m 4"], second: Float[Tensor, "m 4"]) -> Float[Tensor, "m 1"]:
    """Return the error of parallelism in the image: the sine (no unit) of the angle from the first to the second.

    Equal to (l₁m₂ - l₂m₁) / (norm(l₁₂) norm(m₁₂)) for the homogeneous lines l and m. Positive when the second is turned
    clockwise, as seen on the screen, by less than 180°. Swapping the lines, or exchanging the end points of one, flips
    the sign. Zero exactly for parallel and antiparallel segments.
    Degenerate segment: 1, the largest error, since it has no direction.

    >>> parallel(torch.tensor([[0.0, 0.0, 2.0, 0.0]]), torch.tensor([[5.0, 5.0, 8.0, 9.0]]))
    tensor([[0.8000]])
    """
    sine = _cross(direction(first), direction(second))
    return torch.where(is_degenerate(first) | is_degenerate(second), 1.0, sine)[:, None]


def _cross(a: Float[Tensor, "m 2"], b: Float[Tensor, "m 2"]) -> Float[Tensor, " m"]:
    return a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]


def _end_points_to_line(segment: Float[Tensor, "m 4"], line: Float[Tensor, "m 4"]) -> Float[Tensor, "m 2"]:
    return torch.cat([point_to_line(segment[:, :2], line), point_to_line(segment[:, 2:], line)], dim=1)
