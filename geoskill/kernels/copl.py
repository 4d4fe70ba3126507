"""copl: four points lie in one plane."""

from collections.abc import Mapping, Sequence
from itertools import combinations
from typing import ClassVar, Final, final

import torch
from jaxtyping import Bool, Float, Int64
from torch import Tensor

from geoskill.geometry.primitives import NodeType
from geoskill.geometry.space import coplanarity
from geoskill.kernels.enumeration import unordered_pairs
from geoskill.kernels.kernel import Kernel

NEAREST: Final = 12
"""The two points of a side are each among so many that are nearest to the other."""


@final
class Coplanar(Kernel):
    """Four points that come to lie in one plane; the error is how far the fourth is from it, in meters.

    An even permutation of the points keeps it, an odd one flips the sign. Four points of one thing say nothing, so two
    are taken of either side: for every two points that are not near each other, the one instance with a neighbor of
    each whose two segments span the most, for two parallel ones are in one plane wherever the things are. That makes no
    more of them than pairs of points, and not n to the power of four. Points are neighbors when each is among the
    nearest of the other: of a thing with few features, the nearest are on others.
    """

    name: ClassVar[str] = "copl"
    meaning: ClassVar[str] = "four points come to lie in one plane"
    roles: ClassVar[tuple[NodeType, ...]] = (NodeType.POINT,) * 4
    edges: ClassVar[tuple[tuple[int, int], ...]] = tuple(combinations(range(4), 2))
    error_rows: ClassVar[tuple[str, ...]] = ("distance",)
    error_dim: ClassVar[int] = 1
    in_space: ClassVar[bool] = True
    unit: ClassVar[str] = "m"
    resolution: ClassVar[float] = 0.003

    def instances(self, counts: Mapping[NodeType, int]) -> Int64[Tensor, "4 m"]:
        """List all choices of four points; see :meth:`Kernel.instances`. Frames have :meth:`proposals` instead."""
        chosen = list(combinations(range(counts[NodeType.POINT]), 4))
        return torch.tensor(chosen, dtype=torch.long).reshape(-1, 4).T.contiguous()

    def proposals(self, places: Mapping[NodeType, Float[Tensor, "n 3"]]) -> Int64[Tensor, "4 m"]:
        """List the instances of two points on either side; see :meth:`Kernel.proposals`."""
        points = places[NodeType.POINT]
        count = len(points)
        nearest = min(NEAREST, (count - 1) // 3)
        if nearest < 1:
            return torch.zeros(4, 0, dtype=torch.long)
        distance = torch.cdist(points, points)
        neighbors = distance.fill_diagonal_(torch.inf).topk(nearest, dim=1, largest=False).indices
        is_near = torch.zeros(count, count, dtype=torch.bool).scatter_(1, neighbors, True)
        mutual = is_near & is_near.T
        first, second = unordered_pairs(count)
        apart = ~(is_near | is_near.T)[first, second] & mutual.any(dim=1)[first] & mutual.any(dim=1)[second]
        first, second = first[apart], second[apart]
        beside_first, beside_second = _crossing(points, first, second, neighbors, mutual)
        index = torch.stack([first, beside_first, second, beside_second])
        # The same four points may be found from several of their pairs.
        index = index[:, beside_first != beside_second].sort(dim=0).values
        distinct: Tensor = torch.unique(index, dim=1)
        return distinct

    def control_error(self, nodes: Sequence[Float[Tensor, "m 3"]]) -> Float[Tensor, "m 1"]:
        """Return the control error; see :meth:`Kernel.control_error`."""
        return coplanarity(torch.stack(list(nodes)))


def _crossing(
    points: Float[Tensor, "n 3"],
    first: Int64[Tensor, " m"],
    second: Int64[Tensor, " m"],
    neighbors: Int64[Tensor, "n c"],
    mutual: Bool[Tensor, "n n"],
) -> tuple[Int64[Tensor, " m"], Int64[Tensor, " m"]]:
    """Return the mutual neighbors of either point whose segments have the largest cross product.

    The determinant of the error changes by so much when the two sides move against each other.
    """
    arms = points[neighbors] - points[:, None]
    arms = torch.where(mutual.gather(1, neighbors)[..., None], arms, torch.zeros_like(arms))
    squares = arms.square().sum(dim=2)
    crossed = squares[first][:, :, None] * squares[second][:, None] - (arms[first] @ arms[second].mT).square()
    best = crossed.flatten(1).argmax(dim=1)
    rows = best.div(neighbors.shape[1], rounding_mode="floor"), best % neighbors.shape[1]
    beside_first: Tensor = neighbors[first, rows[0]]
    beside_second: Tensor = neighbors[second, rows[1]]
    return beside_first, beside_second
