"""par: a line is parallel to another line in the image."""

from collections.abc import Mapping, Sequence
from typing import ClassVar, final

from jaxtyping import Float, Int64
from torch import Tensor

from geoskill.geometry.control_errors import parallel
from geoskill.geometry.primitives import NodeType
from geoskill.kernels.enumeration import unordered_pairs
from geoskill.kernels.kernel import Kernel


@final
class Parallel(Kernel):
    """Two edges that become parallel; the error is the sine of the angle from the first to the second, up to sign."""

    name: ClassVar[str] = "par"
    meaning: ClassVar[str] = "one line turns parallel to another"
    leaves_free: ClassVar[str] = "motion without turning, and turns about the line"
    roles: ClassVar[tuple[NodeType, ...]] = (NodeType.LINE, NodeType.LINE)
    edges: ClassVar[tuple[tuple[int, int], ...]] = ((0, 1),)
    error_rows: ClassVar[tuple[str, ...]] = ("sine",)
    error_dim: ClassVar[int] = 1
    unit: ClassVar[str] = ""
    resolution: ClassVar[float] = 0.02  # one degree, about the error of a segment of 60 px whose ends are 1 px off

    def instances(self, counts: Mapping[NodeType, int]) -> Int64[Tensor, "2 m"]:
        """List the instances; see :meth:`Kernel.instances`."""
        return unordered_pairs(counts[NodeType.LINE])

    def control_error(self, nodes: Sequence[Float[Tensor, "m 4"]]) -> Float[Tensor, "m 1"]:
        """Return the control error; see :meth:`Kernel.control_error`."""
        first, second = nodes
        return parallel(first, second)
