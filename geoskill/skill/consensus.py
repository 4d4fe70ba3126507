"""What the listed associations of a member say together about the way that is left.

Each one alone may be wrong. But a translation d of the moving thing that brings one pair of a rigid thing to its goal
brings all of them there: with J the derivative of an error with respect to a translation of its moving nodes, goal
error = J d. The translation is fitted by Tukey's biweight, started from the pair of associations whose translation the
median association agrees with best (least median of squares, Rousseeuw 1984), so that up to half may be wrong.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Final, final

import numpy as np
import torch
from jaxtyping import Float64

from geoskill.geometry.robust import MAD_TO_STD, biweight
from geoskill.kernels.kernel import Kernel
from geoskill.skill.association import Association

ROUNDS: Final = 6
MIN_WEIGHT: Final = 0.1
"""Weight above which an association agrees."""
MAX_ASKED: Final = 12
"""Associations that are asked, the best ones: every two of them are tried."""
MIN_DETERMINED: Final = 0.05
"""Of two directions, the one that the errors say less about counts as determined from this ratio on."""


@final
@dataclass(frozen=True)
class Consensus:
    """What the listed associations agree on.

    Attributes:
        share: of the associations asked that agree, in [0, 1]; one without goal error does not.
        offset_px: how far the moving thing is from its goal, x to the right and y down, in pixels of the frame: it has
            to move by minus this. Where the errors are all of one direction, as of parallel lines, the part along it.
    """

    share: float
    offset_px: tuple[float, float]


def consensus(kernel: Kernel, listed: Sequence[Association]) -> Consensus | None:
    """Return what the goal errors of a member's associations agree on, or None with fewer than two of them.

    It is told in pixels: None for a kernel in space.

    Args:
        kernel: of the member; the unit of its error need not be pixels.
        listed: its associations in a frame by rank, of which the first ones are asked.
    """
    listed = listed[:MAX_ASKED]
    known = [association for association in listed if association.goal is not None]
    if len(known) < 2 or kernel.in_space:
        return None
    errors = np.array([association.goal.error for association in known if association.goal is not None])
    noise = np.array([np.linalg.norm(association.goal.std) for association in known if association.goal is not None])
    slopes = _slopes(kernel, known)

    def residuals(offsets: Float64[np.ndarray, "k 2"]) -> Float64[np.ndarray, "k p"]:
        left = errors - np.einsum("pdx,kx->kpd", slopes, offsets)
        return np.asarray(np.linalg.norm(left, axis=2) / np.maximum(noise, 1e-9))

    pairs = np.array(list(combinations(range(len(known)), 2)))
    candidates = _fitted(errors[pairs], slopes[pairs])
    offset = candidates[[int(np.median(residuals(candidates), axis=1).argmin())]]
    weights = np.ones(len(known))
    for _ in range(ROUNDS):
        own = residuals(offset)[0]
        weights = biweight(own, max(1.0, MAD_TO_STD * float(np.median(own))))
        root = np.sqrt(weights) / np.maximum(noise, 1e-9)
        offset = _fitted((errors * root[:, None])[None], (slopes * root[:, None, None])[None])
    share = float((weights > MIN_WEIGHT).sum() / len(listed))
    return Consensus(share, (float(offset[0, 0]), float(offset[0, 1])))


def _fitted(errors: Float64[np.ndarray, "k q d"], slopes: Float64[np.ndarray, "k q d 2"]) -> Float64[np.ndarray, "k 2"]:
    """Return for each set of associations the shortest of the translations with the smallest squared residual."""
    sets = len(errors)
    inverse = np.linalg.pinv(slopes.reshape(sets, -1, 2), rcond=MIN_DETERMINED)
    return np.asarray((inverse @ errors.reshape(sets, -1, 1))[:, :, 0])


def _slopes(kernel: Kernel, associations: Sequence[Association]) -> Float64[np.ndarray, "p d 2"]:
    """Return the derivative of each error with respect to a translation of the moving nodes, at the goal."""
    goals = [association.goal.nodes for association in associations if association.goal is not None]
    moving = [place is not None for place in goals[0]]
    nodes = [
        torch.tensor(
            [
                association.nodes[node].coordinates if goal[node] is None else goal[node]
                for association, goal in zip(associations, goals, strict=True)
            ]
        )
        for node in range(len(moving))
    ]
    with torch.enable_grad():
        shift = torch.zeros(len(associations), 2, requires_grad=True)
        moved = [
            rows + shift.repeat(1, rows.shape[1] // 2) if moves else rows
            for rows, moves in zip(nodes, moving, strict=True)
        ]
        errors = kernel.control_error(moved)
        slopes = [torch.autograd.grad(own.sum(), shift, retain_graph=True)[0] for own in errors.T]
    return np.asarray(torch.stack(slopes, dim=1).numpy(), np.float64)
