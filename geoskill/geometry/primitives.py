"""Node types, and the conventions for the coordinates of points and lines.

Used everywhere in the package:

- image coordinates are pixels of the input frame, x to the right, y down, (0, 0) the center of the top left pixel;
- a point is ``[x, y]``; a line is the segment ``[x1, y1, x2, y2]`` that was detected on it, and the order of its end
  points carries no meaning;
- batches of primitives are arrays or tensors ``[m, 2]`` or ``[m, 4]``.
"""

from enum import StrEnum
from typing import final

import numpy as np
from jaxtyping import Float


@final
class NodeType(StrEnum):
    """Type of the primitive that a kernel's node stands for; the value is the name used in files."""

    POINT = "point"
    LINE = "line"

    @property
    def geometry_dim(self) -> int:
        """Return the number of coordinates of one primitive: 2 for a point, 4 for a line.

        >>> NodeType.LINE.geometry_dim
        4
        """
        return {NodeType.POINT: 2, NodeType.LINE: 4}[self]


def centers(geometry: Float[np.ndarray, "n coordinates"]) -> Float[np.ndarray, "n 2"]:
    """Return the points themselves, or the midpoints of segments, in pixels.

    >>> centers(np.array([[1.0, 1.0, 4.0, 5.0]]))
    array([[2.5, 3. ]])
    """
    midpoints: np.ndarray = geometry.reshape(len(geometry), geometry.shape[1] // 2, 2).mean(axis=1)
    return midpoints
