"""Ellipses in the picture, and the distance of a point to one.

An ellipse is ``[x1, y1, x2, y2, x3, y3, x4, y4]`` in pixels: the ends of two conjugate diameters, of the first and of
the second, such as its axes. An affine map of these four points is that of the ellipse, and their mean is its center.
Source: docs/method.md, Control errors.
"""

from typing import Final

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from geoskill.geometry.control_errors import error_norm

MIN_SEMI_MAJOR_PX: Final = 3.0
"""A smaller ellipse is a dot."""
MIN_SEMI_MINOR_PX: Final = 0.5
"""A thinner ellipse is a stroke."""


def ellipse_of_axes(
    center: tuple[float, float], semi_axes: tuple[float, float], angle_rad: float
) -> Float[np.ndarray, "8"]:
    """Return the ellipse of a center, two semi-axes in pixels, and the angle from x (toward y) to the first of them.

    >>> ellipse_of_axes((5.0, 4.0), (3.0, 2.0), 0.0)
    array([8., 4., 2., 4., 5., 6., 5., 2.])
    """
    along = np.array([np.cos(angle_rad), np.sin(angle_rad)])
    arms = semi_axes[0] * along, semi_axes[1] * np.array([-along[1], along[0]])
    middle = np.asarray(center, np.float64)
    return np.concatenate([middle + arms[0], middle - arms[0], middle + arms[1], middle - arms[1]])


def semi_axes(ellipse: Float[Tensor, "m 8"]) -> Float[Tensor, "m 2"]:
    """Return the semi-major and the semi-minor axis of ellipses, in pixels."""
    _, spread = _center_and_spread(ellipse)
    trace = spread[:, 0, 0] + spread[:, 1, 1]
    difference = torch.hypot(spread[:, 0, 0] - spread[:, 1, 1], 2 * spread[:, 0, 1])
    squares = torch.stack([trace + difference, trace - difference], dim=1) / 2
    return squares.clamp_min(0).sqrt()


def point_to_ellipse(x: Float[Tensor, "m 2"], ellipse: Float[Tensor, "m 8"]) -> Float[Tensor, "m 1"]:
    """Return Sampson's distance in pixels of x to an ellipse: zero on it, positive outside, negative inside.

    With the conic C of the ellipse, signed so that the trace of its first two rows and columns is positive, and x
    homogeneous with x₃ = 1: xᵀCx / norm(2 (Cx)₁₂), the distance to first order. The divisor vanishes at the center; it
    is kept at what makes the error there minus the semi-major axis, half of what it is on the ellipse at least.
    An ellipse below :data:`MIN_SEMI_MAJOR_PX`, or a stroke: the distance to the center.

    To a circle of radius 10, from 20 px off its center and from the center:

    >>> circle = torch.from_numpy(ellipse_of_axes((0.0, 0.0), (10.0, 10.0), 0.0))[None].float()
    >>> point_to_ellipse(torch.tensor([[0.0, 20.0], [0.0, 0.0]]), circle.repeat(2, 1)).flatten()
    tensor([  7.5000, -10.0000])
    """
    center, spread = _center_and_spread(ellipse)
    offset = x - center
    semi_major, semi_minor = semi_axes(ellipse.detach()).unbind(dim=1)
    degenerate = (semi_major < MIN_SEMI_MAJOR_PX) | (semi_minor < MIN_SEMI_MINOR_PX)
    round_dot = torch.eye(2, dtype=spread.dtype, device=spread.device)
    inverse = torch.linalg.inv(torch.where(degenerate[:, None, None], round_dot, spread))
    half_gradient = (inverse @ offset[:, :, None])[:, :, 0]
    value = (offset * half_gradient).sum(dim=1) - 1
    floor = 1 / semi_major.clamp_min(MIN_SEMI_MAJOR_PX)
    error = value / torch.maximum(2 * error_norm(half_gradient), floor)
    return torch.where(degenerate, error_norm(offset), error)[:, None]


def _center_and_spread(ellipse: Float[Tensor, "m 8"]) -> tuple[Float[Tensor, "m 2"], Float[Tensor, "m 2 2"]]:
    """Return the center, and the matrix S for which (X - c)ᵀ S⁻¹ (X - c) = 1 on the ellipse."""
    points = ellipse.reshape(-1, 4, 2)
    arms = torch.stack([points[:, 0] - points[:, 1], points[:, 2] - points[:, 3]], dim=2) / 2
    return points.mean(dim=1), arms @ arms.transpose(1, 2)
