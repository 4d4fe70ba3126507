"""Whether two detections are of the same feature, and two associations of the same features."""

import math
from collections.abc import Sequence

import numpy as np

from geoskill.geometry.primitives import NodeType, centers
from geoskill.geometry.segments import distance_to_segment
from geoskill.kernels.kernel import Kernel, automorphisms
from geoskill.skill.association import Node

TOLERANCE_PX = 3.0
"""Largest distance between a followed feature and the one that counts as the same, that of a region's outline, too.
Three in four followed features are found again within 0.2 px (SIFT at double size, 240 px frames of a hand and cubes).
The rest of the tolerance takes neighbors for the same feature: every second one has another within 3 px, and going
from one to the other hardly changes what is associated."""

TOLERANCE_DEG = 10.0
"""Largest angle between a followed line and the one that counts as the same. End points that are 1 px off turn a short
segment of 20 px by up to 6 degrees; the next direction among the edges of a box is tens of degrees away."""


def is_same_association(
    kernel: Kernel,
    expected: Sequence[Node],
    found: Sequence[Node],
    tolerance_px: float = TOLERANCE_PX,
    tolerance_deg: float = TOLERANCE_DEG,
) -> bool:
    """Whether two associations of a kernel join the same features, in any order that its motif does not tell apart."""
    return any(
        all(
            is_same_feature(expected[place], found[other], tolerance_px, tolerance_deg)
            for place, other in enumerate(order)
        )
        for order in automorphisms(kernel)
    )


def is_same_feature(
    expected: Node, found: Node, tolerance_px: float = TOLERANCE_PX, tolerance_deg: float = TOLERANCE_DEG
) -> bool:
    """Whether two nodes of one frame are the same feature.

    Points are when no more than ``tolerance_px`` apart. Lines are when the midpoint of either one is no more than that
    from the other's segment and their directions differ by no more than ``tolerance_deg``. A detector breaks one edge
    at other places on every frame, so that neither end points nor midpoints have to agree: each piece of an edge is the
    same line as the whole, but another edge farther along on the same straight line is not. A segment without length
    has every direction.
    """
    if expected.node_type is not found.node_type:
        return False
    if expected.node_type is NodeType.POINT:
        return math.dist(expected.coordinates, found.coordinates) <= tolerance_px
    segments = np.array([expected.coordinates, found.coordinates], np.float64)
    apart = distance_to_segment(centers(segments), segments[::-1]).min()
    along, other = segments[:, 2:] - segments[:, :2]
    cross, dot = along[0] * other[1] - along[1] * other[0], along @ other
    # abs folds the order of the end points away; atan2 of two zeros is 0.
    angle_deg = math.degrees(math.atan2(abs(cross), abs(dot)))
    return bool(apart <= tolerance_px and angle_deg <= tolerance_deg)
