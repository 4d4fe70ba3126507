"""l2l: a line is collinear with another line."""

from collections.abc import Mapping, Sequence
from typing import ClassVar, final

from jaxtyping import Float, Int64
from torch import Tensor

from geoskill.geometry.control_errors import line_to_line
from geoskill.geometry.primitives import NodeType
from geoskill.kernels.enumeration import unordered_pairs
from geoskill.kernels.kernel import Kernel


@final
class LineToLine(Kernel):
    """Two edges that come to lie on one line; see :func:`line_to_line` for the error, in pixels, and its sign."""

    name: ClassVar[str] = "l2l"
    meaning: ClassVar[str] = "one line comes to lie on another"
    leaves_free: ClassVar[str] = "motion along the line, and turns about it"
    roles: ClassVar[tuple[NodeType, ...]] = (NodeType.LINE, NodeType.LINE)
    edges: ClassVar[tuple[tuple[int, int], ...]] = ((0, 1),)
    error_rows: ClassVar[tuple[str, ...]] = ("start", "end")
    error_dim: ClassVar[int] = 2
    resolution: ClassVar[float] = 1.0

    def instances(self, counts: Mapping[NodeType, int]) -> Int64[Tensor, "2 m"]:
        """List the instances; see :meth:`Kernel.instances`."""
        return unordered_pairs(counts[NodeType.LINE])

    def control_error(self, nodes: Sequence[Float[Tensor, "m 4"]]) -> Float[Tensor, "m 2"]:
        """Return the control error; see :meth:`Kernel.control_error`."""
        first, second = nodes
        return line_to_line(first, second)
