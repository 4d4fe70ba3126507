"""Tests of whether two nodes are the same feature, and two associations join the same features."""

import math
from collections.abc import Sequence
from typing import Final

import numpy as np
from jaxtyping import Float32

from geoskill.geometry.primitives import NodeType, centers
from geoskill.geometry.segments import distance_to_segment
from geoskill.kernels.kernel import Kernel, automorphisms
from geoskill.skill.association import Node

TOLERANCE_PX = 3.0
"""Largest distance between two nodes of the same feature, as for the outline of a region. Neighbors within it count as
the same feature too, which hardly changes the association (docs/experiments/switches.md)."""

TOLERANCE_DEG = 10.0
"""Largest angle between two lines of the same feature. End points that are off by 1 px turn a segment of 20 px by up to
6 degrees; different edges of a box differ by tens of degrees."""


OUTLINE_SHARE: Final = {NodeType.PLANE: 0.25, NodeType.CONIC: 0.1}
"""Share of its size by which the center of an outline may be off; its size may be by twice that. A hand that passes
over a plane changes its outline."""


def is_same_association(
    kernel: Kernel,
    first: Sequence[Node],
    second: Sequence[Node],
    tolerance_px: float = TOLERANCE_PX,
    tolerance_deg: float = TOLERANCE_DEG,
) -> bool:
    """Return whether two associations of a kernel join the same features.

    The nodes may be in any order that the motif does not tell apart.

    Args:
        kernel: kernel of both associations.
        first: nodes of one association, one for each role.
        second: nodes of the other association, one for each role.
        tolerance_px: see :func:`is_same_feature`.
        tolerance_deg: see :func:`is_same_feature`.
    """
    return any(
        all(
            is_same_feature(first[role], second[other_role], tolerance_px, tolerance_deg)
            for role, other_role in enumerate(order)
        )
        for order in automorphisms(kernel)
    )


def is_same_feature(
    first: Node, second: Node, tolerance_px: float = TOLERANCE_PX, tolerance_deg: float = TOLERANCE_DEG
) -> bool:
    """Return whether two nodes of one frame are the same feature.

    Points are the same feature within ``tolerance_px`` of each other, and outlines of planes and ellipses within a
    share of their size (:data:`OUTLINE_SHARE`). Lines are the same feature when the midpoint of one of them is within
    ``tolerance_px`` of the other segment and their directions differ by at most
    ``tolerance_deg``. Neither end points nor midpoints have to agree, since a detector splits an edge differently in
    every frame: a part of an edge is the same line as the whole edge, but another edge farther along the same straight
    line is not. A segment of length 0 has every direction.
    """
    if first.node_type is not second.node_type:
        return False
    if first.node_type is not NodeType.LINE:
        apart = math.dist(first.center, second.center)
        if first.node_type is NodeType.POINT:
            return apart <= tolerance_px
        sizes = [_size(node) for node in (first, second)]
        share = OUTLINE_SHARE[first.node_type]
        return apart <= tolerance_px + share * min(sizes) and min(sizes) >= (1 - 2 * share) * max(sizes) - tolerance_px
    segments = np.array([first.coordinates, second.coordinates], np.float64)
    distance = distance_to_segment(centers(segments), segments[::-1]).min()
    direction, other_direction = segments[:, 2:] - segments[:, :2]
    cross = direction[0] * other_direction[1] - direction[1] * other_direction[0]
    dot = direction @ other_direction
    # The absolute values make the order of the end points irrelevant; atan2(0, 0) is 0.
    angle_deg = math.degrees(math.atan2(abs(cross), abs(dot)))
    return bool(distance <= tolerance_px and angle_deg <= tolerance_deg)


def _size(node: Node) -> float:
    """Return the root mean square distance of the points of an outline or an ellipse from its center, in pixels."""
    points = np.reshape(node.coordinates, (-1, 2))
    return float(np.sqrt(((points - points.mean(axis=0)) ** 2).sum(axis=1).mean()))


def find_feature(node: Node, geometry: Float32[np.ndarray, "n _"]) -> int | None:
    """Return the row of the nearest feature, by centers, that is the same one as a node; None when there is none.

    Args:
        node: a node of the same frame.
        geometry: of the frame's features of the node's type, in pixels.
    """
    rows = geometry.astype(np.float64)
    nearest_first = np.argsort(np.linalg.norm(centers(rows) - node.center, axis=1), kind="stable")
    # A line may be another one than that with the nearest midpoint, but no point is nearer than the nearest.
    candidates = nearest_first[:1] if node.node_type is NodeType.POINT else nearest_first
    for feature in candidates.tolist():
        if is_same_feature(node, Node(node.node_type, tuple(rows[feature].tolist()))):
            return int(feature)
    return None
