"""Ground truth of real frames: labeled outlines of the object, the target and the hand.

They are read by :func:`geoskill.evaluation.annotations.load.load_regions`.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import final

import cv2
import numpy as np
from jaxtyping import Float32

from geoskill.errors import InputError
from geoskill.evaluation.labels import TOLERANCE_PX, FrameLabels, Labels
from geoskill.geometry.primitives import NodeType, centers
from geoskill.simulation.roles import SceneRole

Polygon = Float32[np.ndarray, "_ 2"]

ROLES: Mapping[str, SceneRole] = {"object": SceneRole.OBJECT, "target": SceneRole.TARGET, "hand": SceneRole.AGENT}
"""The roles by their names in files and settings; ``hand`` is the agent, a hand or a gripper."""


@final
@dataclass(frozen=True, eq=False)
class FrameRegions(FrameLabels):
    """Outlines of one frame.

    Attributes:
        polygons: ``[v, 2]`` in pixels for each role; without vertices where the region is out of view.
        pieces: the other polygons of a region that is seen in several pieces.
        holes: polygons inside of a region that do not belong to it, up to their outlines.
    """

    polygons: Mapping[SceneRole, Polygon]
    pieces: Mapping[SceneRole, Sequence[Polygon]] = field(default_factory=dict)
    holes: Mapping[SceneRole, Sequence[Polygon]] = field(default_factory=dict)

    def signed_distance(self, role: SceneRole, point: tuple[float, float]) -> float:
        """Return the distance in pixels to a region's outline: positive inside, 0 on it, ``-inf`` when out of view."""
        outer = max(_signed_distance(polygon, point) for polygon in (self.polygons[role], *self.pieces.get(role, ())))
        return min(outer, *(-_signed_distance(hole, point) for hole in self.holes.get(role, ())), math.inf)

    def is_simple(self, role: SceneRole) -> bool:
        """Return whether a region is a single polygon, or none."""
        return not (self.pieces.get(role) or self.holes.get(role))

    def contains(self, role: SceneRole, point: tuple[float, float], tolerance_px: float = TOLERANCE_PX) -> bool:
        """Return whether a point is in a region or within ``tolerance_px`` of it, whatever the other regions are."""
        return self.signed_distance(role, point) >= -tolerance_px

    def label(
        self,
        point: tuple[float, float],
        tolerance_px: float = TOLERANCE_PX,
        among: Sequence[SceneRole] = tuple(SceneRole),
    ) -> SceneRole | None:
        """See :meth:`FrameLabels.label`."""
        distances = {role: self.signed_distance(role, point) for role in among}
        for tolerance in (0.0, tolerance_px):
            for role, distance in distances.items():
                if distance >= -tolerance:
                    return role
        return None

    def at_goal(self, coordinates: Sequence[tuple[float, float]]) -> None:
        """Return None: polygons do not include the goal."""

    def feature_label(
        self,
        node_type: NodeType,
        coordinates: Sequence[float],
        tolerance_px: float = TOLERANCE_PX,
        among: Sequence[SceneRole] = tuple(SceneRole),
    ) -> SceneRole | None:
        """See :meth:`FrameLabels.feature_label`."""
        x, y = centers(np.array([coordinates], np.float64))[0].tolist()
        return self.label((x, y), tolerance_px, among)

    def feature_at_goal(
        self, node_type: NodeType, coordinates: Sequence[float], space: Sequence[float] | None, in_space: bool
    ) -> None:
        """Return None: polygons do not include the goal."""

    @property
    def goal_pixel_m(self) -> None:
        """None: polygons have no metric size."""


@final
@dataclass(frozen=True, eq=False)
class Regions(Labels):
    """Labeled frames of one sequence.

    Attributes:
        name: path of the file, for messages.
        image_size: width and height in pixels of the labeled images.
        labeled: polygons of each labeled frame by its number; at least one frame.
    """

    name: str
    image_size: tuple[int, int]
    labeled: Mapping[int, FrameRegions]

    @property
    def first_frame(self) -> int:
        """Smallest number of a labeled frame."""
        return min(self.labeled)

    @property
    def last_frame(self) -> int:
        """Largest number of a labeled frame."""
        return max(self.labeled)

    def at(self, frame: int) -> FrameRegions | None:
        """Interpolate the polygons of a frame; None before the first and after the last labeled frame.

        Between two labeled frames each vertex moves linearly. When their numbers of vertices differ, or the region is
        out of view or in several pieces on one of them, it is as in the nearer labeled frame, and halfway as in the
        earlier one.
        """
        if not self.first_frame <= frame <= self.last_frame:
            return None
        before = max(number for number in self.labeled if number <= frame)
        after = min(number for number in self.labeled if number >= frame)
        fraction = (frame - before) / max(after - before, 1)
        earlier, later = self.labeled[before], self.labeled[after]
        nearer = earlier if fraction <= 0.5 else later
        between = {
            role: _interpolated(earlier.polygons[role], later.polygons[role], fraction)
            for role in SceneRole
            if earlier.is_simple(role)
            and later.is_simple(role)
            and len(earlier.polygons[role]) == len(later.polygons[role])
        }
        return FrameRegions({**nearer.polygons, **between}, nearer.pieces, nearer.holes)

    def require_size(self, image_size: tuple[int, int]) -> None:
        """Raise InputError unless ``image_size``, width and height of the video in pixels, is that of the labels."""
        if image_size != self.image_size:
            raise InputError(
                f"{self.name}: image_size is {size_text(self.image_size)}; expected {size_text(image_size)}, the frame"
                " size of the video, since polygons are pixels of its native frames"
            )


def polygon_of(vertices: Sequence[Sequence[float]]) -> Polygon:
    """Return vertices ``[x, y]`` as a polygon."""
    return np.array(vertices, np.float32).reshape(-1, 2)


def size_text(image_size: tuple[int, int]) -> str:
    """Return width and height as messages have them."""
    return f"{image_size[0]}x{image_size[1]}"


def _signed_distance(polygon: Polygon, point: tuple[float, float]) -> float:
    if len(polygon) == 0:
        return -math.inf
    return float(cv2.pointPolygonTest(polygon, (float(point[0]), float(point[1])), True))


def _interpolated(earlier: Polygon, later: Polygon, fraction: float) -> Polygon:
    return np.asarray((1.0 - fraction) * earlier + fraction * later, np.float32)
