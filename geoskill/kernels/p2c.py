"""p2c: a point is on a conic."""

from collections.abc import Mapping, Sequence
from typing import ClassVar, final

from jaxtyping import Float, Int64
from torch import Tensor

from geoskill.geometry.ellipses import point_to_ellipse
from geoskill.geometry.primitives import NodeType
from geoskill.kernels.enumeration import all_pairs
from geoskill.kernels.kernel import Kernel


@final
class PointToConic(Kernel):
    """A point that comes to lie on an ellipse; the error is Sampson's distance in pixels, negative inside."""

    name: ClassVar[str] = "p2c"
    meaning: ClassVar[str] = "a point comes onto an ellipse"
    roles: ClassVar[tuple[NodeType, ...]] = (NodeType.POINT, NodeType.CONIC)
    edges: ClassVar[tuple[tuple[int, int], ...]] = ((0, 1),)
    error_rows: ClassVar[tuple[str, ...]] = ("distance",)
    error_dim: ClassVar[int] = 1
    resolution: ClassVar[float] = 1.0

    def instances(self, counts: Mapping[NodeType, int]) -> Int64[Tensor, "2 m"]:
        """List the instances; see :meth:`Kernel.instances`."""
        return all_pairs(counts[NodeType.POINT], counts[NodeType.CONIC])

    def control_error(self, nodes: Sequence[Float[Tensor, "m _"]]) -> Float[Tensor, "m 1"]:
        """Return the control error; see :meth:`Kernel.control_error`."""
        point, ellipse = nodes
        return point_to_ellipse(point, ellipse)
