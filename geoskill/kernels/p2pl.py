"""p2pl: a point is on a plane."""

from collections.abc import Mapping, Sequence
from typing import ClassVar, final

from jaxtyping import Float, Int64
from torch import Tensor

from geoskill.geometry.primitives import NodeType
from geoskill.geometry.space import point_to_plane
from geoskill.kernels.enumeration import all_pairs
from geoskill.kernels.kernel import Kernel


@final
class PointToPlane(Kernel):
    """A point that comes onto a plane; the error is its distance in meters, positive on the camera's side."""

    name: ClassVar[str] = "p2pl"
    meaning: ClassVar[str] = "a point comes onto a plane"
    leaves_free: ClassVar[str] = "motion along the plane, and turns about the point"
    roles: ClassVar[tuple[NodeType, ...]] = (NodeType.POINT, NodeType.PLANE)
    edges: ClassVar[tuple[tuple[int, int], ...]] = ((0, 1),)
    error_rows: ClassVar[tuple[str, ...]] = ("distance",)
    error_dim: ClassVar[int] = 1
    in_space: ClassVar[bool] = True
    unit: ClassVar[str] = "m"
    resolution: ClassVar[float] = 0.003

    def instances(self, counts: Mapping[NodeType, int]) -> Int64[Tensor, "2 m"]:
        """List the instances; see :meth:`Kernel.instances`."""
        return all_pairs(counts[NodeType.POINT], counts[NodeType.PLANE])

    def control_error(self, nodes: Sequence[Float[Tensor, "m _"]]) -> Float[Tensor, "m 1"]:
        """Return the control error; see :meth:`Kernel.control_error`."""
        point, plane = nodes
        return point_to_plane(point, plane)
