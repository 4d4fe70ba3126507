"""p2l: a point is on a line."""

from collections.abc import Mapping, Sequence
from typing import ClassVar, final

from jaxtyping import Float, Int64
from torch import Tensor

from geoskill.geometry.control_errors import point_to_line
from geoskill.geometry.primitives import NodeType
from geoskill.kernels.enumeration import all_pairs
from geoskill.kernels.kernel import Kernel


@final
class PointToLine(Kernel):
    """A point that comes to lie on an edge; the error is its signed distance to the edge's line in pixels."""

    name: ClassVar[str] = "p2l"
    meaning: ClassVar[str] = "a point comes onto a line"
    leaves_free: ClassVar[str] = "motion along the line, and turns about the point"
    roles: ClassVar[tuple[NodeType, ...]] = (NodeType.POINT, NodeType.LINE)
    edges: ClassVar[tuple[tuple[int, int], ...]] = ((0, 1),)
    error_rows: ClassVar[tuple[str, ...]] = ("distance",)
    error_dim: ClassVar[int] = 1
    resolution: ClassVar[float] = 1.0

    def instances(self, counts: Mapping[NodeType, int]) -> Int64[Tensor, "2 m"]:
        """List the instances; see :meth:`Kernel.instances`."""
        return all_pairs(counts[NodeType.POINT], counts[NodeType.LINE])

    def control_error(self, nodes: Sequence[Float[Tensor, "m _"]]) -> Float[Tensor, "m 1"]:
        """Return the control error; see :meth:`Kernel.control_error`."""
        point, line = nodes
        return point_to_line(point, line)
