"""How much of a motion in the picture several kernels fix together: the rank of their errors' derivatives.

What is carried moves in a picture by shifts, turns and growth. One association of each kernel lies somewhere, and
holds: its points at a place, its lines through that place in one direction. The ranks are those of one camera and a
thing that moves along x, y, z and turns about the vertical.
"""

import math
from collections.abc import Sequence
from typing import Final

import torch
from torch import Tensor

from geoskill.geometry.primitives import NodeType
from geoskill.kernels.kernel import Kernel

SHIFTS: Final = 2
"""The first two of the four motions."""


def picture_rank(kernels: Sequence[Kernel], *, shifts_only: bool = False) -> int:
    """Return the rank for one association of each kernel, whose first node moves.

    Args:
        kernels: of a skill; of two of one kind, each has an association of its own.
        shifts_only: of shifts alone, which say whether a place is fixed.
    """
    if not kernels:
        return 0
    generator = torch.Generator().manual_seed(0)
    jacobian = torch.cat([_jacobian(kernel, generator) for kernel in kernels])
    return int(torch.linalg.matrix_rank(jacobian[:, :SHIFTS] if shifts_only else jacobian, rtol=1e-6))


def _jacobian(kernel: Kernel, generator: torch.Generator) -> Tensor:
    """Return derivatives ``[d, 4]`` of the error of an association by shifts, a turn, and the logarithm of a growth."""
    draw = torch.rand(3, generator=generator, dtype=torch.float64)
    place, angle = 100 * draw[:2], math.pi * draw[2]
    along = torch.stack([angle.cos(), angle.sin()])
    nodes = [
        place if kind is NodeType.POINT else torch.cat([place + 20 * node * along, place + (50 + 20 * node) * along])
        for node, kind in enumerate(kernel.roles)
    ]

    def error(motion: Tensor) -> Tensor:
        cosine, sine = motion[2].cos(), motion[2].sin()
        turn = torch.stack([torch.stack([cosine, -sine]), torch.stack([sine, cosine])])
        moved = (nodes[0].reshape(-1, 2) @ turn.T * motion[3].exp() + motion[:SHIFTS]).flatten()
        return kernel.control_error([own[None] for own in (moved, *nodes[1:])])[0]

    rest = torch.zeros(4, dtype=torch.float64, requires_grad=True)
    rows = [torch.autograd.grad(row, rest, retain_graph=True)[0] for row in error(rest)]
    return torch.stack(rows)
