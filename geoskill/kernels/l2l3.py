"""l2l3: a line is collinear with another line in space."""

from collections.abc import Mapping, Sequence
from typing import ClassVar, final

from jaxtyping import Float, Int64
from torch import Tensor

from geoskill.geometry.primitives import NodeType
from geoskill.geometry.space import line_to_line_in_space
from geoskill.kernels.enumeration import unordered_pairs
from geoskill.kernels.kernel import Kernel


@final
class LineToLineInSpace(Kernel):
    """Two edges that come to lie on one line in space; the error is their offsets at two places, in meters."""

    name: ClassVar[str] = "l2l3"
    meaning: ClassVar[str] = "one line comes to lie on another, in space"
    leaves_free: ClassVar[str] = "motion along the line, and turns about it"
    roles: ClassVar[tuple[NodeType, ...]] = (NodeType.LINE, NodeType.LINE)
    edges: ClassVar[tuple[tuple[int, int], ...]] = ((0, 1),)
    error_rows: ClassVar[tuple[str, ...]] = ("start_x", "start_y", "start_z", "end_x", "end_y", "end_z")
    error_dim: ClassVar[int] = 6
    rank: ClassVar[int | None] = 4
    in_space: ClassVar[bool] = True
    unit: ClassVar[str] = "m"
    resolution: ClassVar[float] = 0.003

    def instances(self, counts: Mapping[NodeType, int]) -> Int64[Tensor, "2 m"]:
        """List the instances; see :meth:`Kernel.instances`."""
        return unordered_pairs(counts[NodeType.LINE])

    def control_error(self, nodes: Sequence[Float[Tensor, "m 6"]]) -> Float[Tensor, "m 6"]:
        """Return the control error; see :meth:`Kernel.control_error`."""
        first, second = nodes
        return line_to_line_in_space(first, second)
