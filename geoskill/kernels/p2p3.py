"""p2p3: the coincidence of two points in space."""

from collections.abc import Mapping, Sequence
from typing import ClassVar, final

from jaxtyping import Float, Int64
from torch import Tensor

from geoskill.geometry.primitives import NodeType
from geoskill.geometry.space import point_to_point_in_space
from geoskill.kernels.enumeration import unordered_pairs
from geoskill.kernels.kernel import Kernel


@final
class PointToPointInSpace(Kernel):
    """Two points that come together in space; the error is first minus second, in meters, and flips with a swap."""

    name: ClassVar[str] = "p2p3"
    meaning: ClassVar[str] = "one point comes onto another, in space"
    leaves_free: ClassVar[str] = "turns about the point"
    roles: ClassVar[tuple[NodeType, ...]] = (NodeType.POINT, NodeType.POINT)
    edges: ClassVar[tuple[tuple[int, int], ...]] = ((0, 1),)
    error_rows: ClassVar[tuple[str, ...]] = ("x", "y", "z")
    error_dim: ClassVar[int] = 3
    in_space: ClassVar[bool] = True
    unit: ClassVar[str] = "m"
    resolution: ClassVar[float] = 0.003

    def instances(self, counts: Mapping[NodeType, int]) -> Int64[Tensor, "2 m"]:
        """List the instances; see :meth:`Kernel.instances`."""
        return unordered_pairs(counts[NodeType.POINT])

    def control_error(self, nodes: Sequence[Float[Tensor, "m 3"]]) -> Float[Tensor, "m 3"]:
        """Return the control error; see :meth:`Kernel.control_error`."""
        first, second = nodes
        return point_to_point_in_space(first, second)
