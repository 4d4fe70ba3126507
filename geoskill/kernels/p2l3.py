"""p2l3: a point is on a line in space."""

from collections.abc import Mapping, Sequence
from typing import ClassVar, final

from jaxtyping import Float, Int64
from torch import Tensor

from geoskill.geometry.primitives import NodeType
from geoskill.geometry.space import point_to_line_in_space
from geoskill.kernels.enumeration import all_pairs
from geoskill.kernels.kernel import Kernel


@final
class PointToLineInSpace(Kernel):
    """A point that comes to lie on an edge in space; the error is its offset from the edge's line, in meters."""

    name: ClassVar[str] = "p2l3"
    meaning: ClassVar[str] = "a point comes onto a line, in space"
    leaves_free: ClassVar[str] = "motion along the line, and turns about the point"
    roles: ClassVar[tuple[NodeType, ...]] = (NodeType.POINT, NodeType.LINE)
    edges: ClassVar[tuple[tuple[int, int], ...]] = ((0, 1),)
    error_rows: ClassVar[tuple[str, ...]] = ("x", "y", "z")
    error_dim: ClassVar[int] = 3
    rank: ClassVar[int | None] = 2
    in_space: ClassVar[bool] = True
    unit: ClassVar[str] = "m"
    resolution: ClassVar[float] = 0.003

    def instances(self, counts: Mapping[NodeType, int]) -> Int64[Tensor, "2 m"]:
        """List the instances; see :meth:`Kernel.instances`."""
        return all_pairs(counts[NodeType.POINT], counts[NodeType.LINE])

    def control_error(self, nodes: Sequence[Float[Tensor, "m _"]]) -> Float[Tensor, "m 3"]:
        """Return the control error; see :meth:`Kernel.control_error`."""
        first, second = nodes
        return point_to_line_in_space(first, second)
