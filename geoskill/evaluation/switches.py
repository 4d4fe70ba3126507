"""How often a skill changes its mind: switches of the top association that the scene did not ask for.

The nodes of the top association are followed by optical flow from one judged frame to the next. Only where all of them
arrive, so that the association could have been kept, is the transition comparable; it is a switch when the next top
association joins other features.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import final

import numpy as np
from jaxtyping import Float64, UInt8

from geoskill.features.flow import follow_features
from geoskill.geometry.primitives import NodeType
from geoskill.kernels.kernel import Kernel, automorphisms
from geoskill.skill.association import Association, Node

TOLERANCE_PX = 3.0
"""Largest distance between a followed feature and the one that counts as the same, that of a region's outline, too.
Three in four followed features are found again within 0.2 px (SIFT at double size, 240 px frames of a hand and cubes).
The rest of the tolerance takes neighbours for the same feature: every second one has another within 3 px, and going
from one to the other hardly changes what is associated."""

TOLERANCE_DEG = 10.0
"""Largest angle between a followed line and the one that counts as the same. End points that are 1 px off turn a short
segment of 20 px by up to 6 degrees; the next direction among the edges of a box is tens of degrees away."""


@final
@dataclass(frozen=True)
class SwitchCount:
    """Transitions that could be compared, and how many of them were switches."""

    switches: int
    comparable: int


@final
class SwitchCounter:
    """Counts the switches of one ensemble member along a sequence, keeping no more than one frame.

    Every frame of the sequence goes through :meth:`advance`. On those to be judged, :meth:`judge` follows it. Frames in
    between are stepping stones: nodes are followed from frame to frame, since flow fails over the long way that things
    move in many frames.

    Args:
        kernel: the member's kernel.
    """

    def __init__(self, kernel: Kernel) -> None:
        self._kernel = kernel
        self._image: UInt8[np.ndarray, "height width 3"] | None = None
        self._followed: tuple[Node, ...] | None = None
        self._switches = 0
        self._comparable = 0

    @property
    def count(self) -> SwitchCount:
        """The sum so far."""
        return SwitchCount(self._switches, self._comparable)

    def advance(self, image: UInt8[np.ndarray, "height width 3"]) -> None:
        """Goes on to the next RGB frame, following the nodes of the last top association if they are still there."""
        if self._followed is not None and self._image is not None:
            self._followed = follow_nodes(self._followed, self._image, image)
        self._image = image

    def judge(self, top: Association | None) -> bool | None:
        """Whether the top association of this frame is a switch.

        None where the transition is not comparable: on the first judged frame, when a node was lost on the way, or when
        this frame or the one judged before has no association.
        """
        before, self._followed = self._followed, None if top is None else top.nodes
        if before is None or top is None:
            return None
        switched = not is_same_association(self._kernel, before, top.nodes)
        self._switches += switched
        self._comparable += 1
        return switched


def follow_nodes(
    nodes: Sequence[Node], start: UInt8[np.ndarray, "height width 3"], end: UInt8[np.ndarray, "height width 3"]
) -> tuple[Node, ...] | None:
    """The nodes of RGB frame ``start`` where they lie in ``end``, or None when one of them could not be followed.

    A line's place along itself is uncertain (see :func:`geoskill.features.flow.follow_features`).
    """
    moved = list(nodes)
    for node_type in dict.fromkeys(node.node_type for node in nodes):
        places = [place for place, node in enumerate(nodes) if node.node_type is node_type]
        geometry = np.array([nodes[place].coordinates for place in places], np.float32)
        geometry, followed = follow_features(node_type, geometry, start, end)
        if not followed.all():
            return None
        for place, row in zip(places, geometry.tolist(), strict=True):
            moved[place] = Node(node_type, tuple(row))
    return tuple(moved)


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
    first, second = (np.reshape(node.coordinates, (2, 2)).astype(np.float64) for node in (expected, found))
    apart = min(_distance_to_segment(second.mean(axis=0), first), _distance_to_segment(first.mean(axis=0), second))
    along, other = first[1] - first[0], second[1] - second[0]
    cross, dot = along[0] * other[1] - along[1] * other[0], along @ other
    # abs folds the order of the end points away; atan2 of two zeros is 0.
    angle_deg = math.degrees(math.atan2(abs(cross), abs(dot)))
    return bool(apart <= tolerance_px and angle_deg <= tolerance_deg)


def _distance_to_segment(point: Float64[np.ndarray, "2"], segment: Float64[np.ndarray, "2 2"]) -> float:
    start, along = segment[0], segment[1] - segment[0]
    squared_length = float(along @ along)
    share = 0.0 if squared_length == 0.0 else min(1.0, max(0.0, float((point - start) @ along) / squared_length))
    return float(np.linalg.norm(point - (start + share * along)))
