"""par3: a line is parallel to another line in space."""

from collections.abc import Mapping, Sequence
from typing import ClassVar, final

from jaxtyping import Float, Int64
from torch import Tensor

from geoskill.geometry.primitives import NodeType
from geoskill.geometry.space import parallel_in_space
from geoskill.kernels.enumeration import unordered_pairs
from geoskill.kernels.kernel import Kernel


@final
class ParallelInSpace(Kernel):
    """Two edges that become parallel in space; the error is the cross product of their directions, up to sign."""

    name: ClassVar[str] = "par3"
    meaning: ClassVar[str] = "one line turns parallel to another, in space"
    leaves_free: ClassVar[str] = "motion without turning, and turns about the line"
    roles: ClassVar[tuple[NodeType, ...]] = (NodeType.LINE, NodeType.LINE)
    edges: ClassVar[tuple[tuple[int, int], ...]] = ((0, 1),)
    error_rows: ClassVar[tuple[str, ...]] = ("x", "y", "z")
    error_dim: ClassVar[int] = 3
    rank: ClassVar[int | None] = 2
    in_space: ClassVar[bool] = True
    unit: ClassVar[str] = ""
    resolution: ClassVar[float] = 0.04  # two degrees, about the error of two lines of 100 mm at 0.7 m from a D435

    def instances(self, counts: Mapping[NodeType, int]) -> Int64[Tensor, "2 m"]:
        """List the instances; see :meth:`Kernel.instances`."""
        return unordered_pairs(counts[NodeType.LINE])

    def control_error(self, nodes: Sequence[Float[Tensor, "m 6"]]) -> Float[Tensor, "m 3"]:
        """Return the control error; see :meth:`Kernel.control_error`."""
        first, second = nodes
        return parallel_in_space(first, second)
