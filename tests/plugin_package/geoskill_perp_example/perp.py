"""perp: a line is perpendicular to another line in the image."""

from collections.abc import Mapping, Sequence
from typing import ClassVar, final

import torch
from jaxtyping import Float, Int64
from torch import Tensor

from geoskill.geometry.primitives import NodeType
from geoskill.geometry.segments import direction, is_degenerate
from geoskill.kernels.enumeration import unordered_pairs
from geoskill.kernels.kernel import Kernel


@final
class Perpendicular(Kernel):
    """Two edges that turn perpendicular; the error is the cosine of the angle between them, up to sign.

    Exchanging the end points of one edge flips the sign. A degenerate segment has no direction: its error is 1.
    """

    name: ClassVar[str] = "perp"
    meaning: ClassVar[str] = "one line turns perpendicular to another"
    roles: ClassVar[tuple[NodeType, ...]] = (NodeType.LINE, NodeType.LINE)
    edges: ClassVar[tuple[tuple[int, int], ...]] = ((0, 1),)
    error_dim: ClassVar[int] = 1
    unit: ClassVar[str] = ""
    resolution: ClassVar[float] = 0.02  # one degree off the right angle

    def instances(self, counts: Mapping[NodeType, int]) -> Int64[Tensor, "2 m"]:
        """See :meth:`Kernel.instances`."""
        return unordered_pairs(counts[NodeType.LINE])

    def control_error(self, nodes: Sequence[Float[Tensor, "m 4"]]) -> Float[Tensor, "m 1"]:
        """See :meth:`Kernel.control_error`."""
        first, second = nodes
        cosine = (direction(first) * direction(second)).sum(dim=1)
        return torch.where(is_degenerate(first) | is_degenerate(second), 1.0, cosine)[:, None]
