"""Geometric primitives as rows of numbers.

Conventions, used everywhere in the package:

- image coordinates are pixels of the input frame, x to the right, y down, (0, 0) the center of the top left pixel;
- a point is ``[x, y]``; a line is the segment ``[x1, y1, x2, y2]`` that was detected on it, whose end points have no
  order;
- batches of primitives are tensors ``[m, 2]`` or ``[m, 4]``.
"""

from enum import StrEnum
from typing import final


@final
class NodeType(StrEnum):
    """The kind of primitive that a node of a kernel stands for; its value is the name used in files."""

    POINT = "point"
    LINE = "line"

    @property
    def geometry_dim(self) -> int:
        """Numbers that describe one primitive of this type.

        >>> NodeType.LINE.geometry_dim
        4
        """
        return {NodeType.POINT: 2, NodeType.LINE: 4}[self]
