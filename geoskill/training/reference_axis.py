"""The direction by which segments are directed, fitted to the demonstration."""

import math
from collections.abc import Sequence

import torch
from jaxtyping import Float
from torch import Tensor

from geoskill.geometry.primitives import NodeType
from geoskill.geometry.segments import direction
from geoskill.graphs.motif_graph import MotifGraph
from geoskill.kernels.kernel import reference_line
from geoskill.model.kernel_model import KernelModel
from geoskill.training.selected_frames import selected_frames

# Directions tried, one a degree.
DIRECTIONS = 180
# A line at right angles to the axis costs log(MIN_COSINE), and not infinitely much.
MIN_COSINE = 0.02


def fit_reference_axis(member: KernelModel, graphs: Sequence[MotifGraph]) -> None:
    """Fit a member's ``reference_axis`` to the reference lines of what it selects; without a line it stays as it is.

    Args:
        member: with its final weights, in evaluation mode.
        graphs: of the demonstration's frames, with instances.
    """
    reference = reference_line(member.kernel)
    if reference is None:
        return
    directions, weights = [], []
    for frame in selected_frames(member, graphs):
        lines = member.attribute(frame.graph, "geometry")[NodeType.LINE][frame.index[reference]]
        directions.append(direction(lines))
        weights.append(frame.weight)
    if directions:
        member.set_reference_axis(axis_of(torch.cat(directions), torch.cat(weights)))


def axis_of(directions: Float[Tensor, "n 2"], weights: Float[Tensor, " n"]) -> Float[Tensor, "2"]:
    """Return the unit vector that no direction is nearly at right angles to, so that noise turns none of them round.

    It maximizes the weighted mean of log(abs(cos)), over one degree each. For lines of one direction it is that
    direction, for edges of a box the diagonal between them. (The mean of doubled angles would be one of two edges, and
    the other at right angles to it.)

    >>> axis_of(torch.tensor([[0.0, 1.0], [0.0, -1.0]]), torch.ones(2)).round(decimals=4).tolist()
    [0.0, 1.0]
    """
    angles = torch.arange(DIRECTIONS, dtype=torch.float64) * (math.pi / DIRECTIONS)
    axes = torch.stack([angles.cos(), angles.sin()], dim=1)
    cosines = (directions.double() @ axes.T).abs().clamp_min(MIN_COSINE)
    best = int((weights.double() @ cosines.log()).argmax())
    return axes[best].to(directions.dtype)
