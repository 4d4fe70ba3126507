"""copl2: two lines lie in one plane."""

from collections.abc import Mapping, Sequence
from typing import ClassVar, final

from jaxtyping import Float, Int64
from torch import Tensor

from geoskill.geometry.primitives import NodeType
from geoskill.geometry.space import lines_coplanarity
from geoskill.kernels.enumeration import unordered_pairs
from geoskill.kernels.kernel import Kernel


@final
class LinesCoplanar(Kernel):
    """Two edges that come to lie in one plane; the error is the distance of their lines in meters, up to sign.

    Parallel lines are coplanar.
    """

    name: ClassVar[str] = "copl2"
    meaning: ClassVar[str] = "two lines come to lie in one plane"
    roles: ClassVar[tuple[NodeType, ...]] = (NodeType.LINE, NodeType.LINE)
    edges: ClassVar[tuple[tuple[int, int], ...]] = ((0, 1),)
    error_rows: ClassVar[tuple[str, ...]] = ("distance",)
    error_dim: ClassVar[int] = 1
    in_space: ClassVar[bool] = True
    unit: ClassVar[str] = "m"
    resolution: ClassVar[float] = 0.003

    def instances(self, counts: Mapping[NodeType, int]) -> Int64[Tensor, "2 m"]:
        """List the instances; see :meth:`Kernel.instances`."""
        return unordered_pairs(counts[NodeType.LINE])

    def control_error(self, nodes: Sequence[Float[Tensor, "m 6"]]) -> Float[Tensor, "m 1"]:
        """Return the control error; see :meth:`Kernel.control_error`."""
        first, second = nodes
        return lines_coplanarity(first, second)
