"""p2p: the coincidence of two points."""

from collections.abc import Mapping, Sequence
from typing import ClassVar, final

from jaxtyping import Float, Int64
from torch import Tensor

from geoskill.geometry.control_errors import point_to_point
from geoskill.geometry.primitives import NodeType
from geoskill.kernels.enumeration import unordered_pairs
from geoskill.kernels.kernel import Kernel


@final
class PointToPoint(Kernel):
    """Two points that come together; the error is first minus second, in pixels, and flips when they are swapped."""

    name: ClassVar[str] = "p2p"
    meaning: ClassVar[str] = "one point comes onto another"
    leaves_free: ClassVar[str] = "turns about the point"
    roles: ClassVar[tuple[NodeType, ...]] = (NodeType.POINT, NodeType.POINT)
    edges: ClassVar[tuple[tuple[int, int], ...]] = ((0, 1),)
    error_rows: ClassVar[tuple[str, ...]] = ("x", "y")
    error_dim: ClassVar[int] = 2
    resolution: ClassVar[float] = 1.0

    def instances(self, counts: Mapping[NodeType, int]) -> Int64[Tensor, "2 m"]:
        """List the instances; see :meth:`Kernel.instances`."""
        return unordered_pairs(counts[NodeType.POINT])

    def control_error(self, nodes: Sequence[Float[Tensor, "m 2"]]) -> Float[Tensor, "m 2"]:
        """Return the control error; see :meth:`Kernel.control_error`."""
        first, second = nodes
        return point_to_point(first, second)
