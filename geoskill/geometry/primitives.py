"""Node types, and the conventions for the coordinates of points and lines.

Used everywhere in the package:

- image coordinates are pixels of the input frame, x to the right, y down, (0, 0) the center of the top left pixel;
- a point is ``[x, y]``; a line is the segment ``[x1, y1, x2, y2]`` that was detected on it, and the order of its end
  points carries no meaning; a plane is the box of four corners around the pixels that show it; a conic is an ellipse,
  the four ends of two conjugate diameters (:mod:`geoskill.geometry.ellipses`);
- so all of them are points, side by side, whose mean is the center, and which a map of the picture takes along;
- in space, in meters of the camera's frame (x to the right, y down, z forward), a point is ``[x, y, z]``, a line its
  two ends, a plane ``[n, d]`` with n·X + d = 0 and n of unit length toward the camera; conics are in pictures only;
- batches of primitives are arrays or tensors ``[m, g]``.
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
    PLANE = "plane"
    CONIC = "conic"

    @property
    def geometry_dim(self) -> int:
        """Return the number of coordinates of one primitive in the picture: 2 for a point, 4 for a line.

        >>> NodeType.LINE.geometry_dim
        4
        """
        return {NodeType.POINT: 2, NodeType.LINE: 4, NodeType.PLANE: 8, NodeType.CONIC: 8}[self]

    @property
    def space_dim(self) -> int:
        """Return the number of coordinates of one primitive in space; 0 for a conic, which is in pictures only.

        >>> [node_type.space_dim for node_type in NodeType]
        [3, 6, 4, 0]
        """
        return {NodeType.POINT: 3, NodeType.LINE: 6, NodeType.PLANE: 4, NodeType.CONIC: 0}[self]


def centers(geometry: Float[np.ndarray, "n coordinates"]) -> Float[np.ndarray, "n 2"]:
    """Return the points themselves, or the midpoints of segments and the centers of outlines, in pixels.

    >>> centers(np.array([[1.0, 1.0, 4.0, 5.0]]))
    array([[2.5, 3. ]])
    """
    midpoints: np.ndarray = geometry.reshape(len(geometry), geometry.shape[1] // 2, 2).mean(axis=1)
    return midpoints
