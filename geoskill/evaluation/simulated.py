"""Ground truth of rendered frames."""

from collections.abc import Sequence
from functools import cached_property
from typing import final

import numpy as np
from jaxtyping import Int

from geoskill.evaluation.labels import TOLERANCE_PX, FrameLabels, Labels
from geoskill.geometry.poses import inverse, transform
from geoskill.geometry.primitives import NodeType, centers
from geoskill.simulation.goal_truth import ellipse_at_goal, plane_at_goal, plane_role
from geoskill.simulation.ground_truth import (
    FrameGroundTruth,
    SurfacePoint,
    goal_pixel_m,
    goal_pixels,
    goal_positions,
)
from geoskill.simulation.recording import Recording
from geoskill.simulation.roles import SceneRole

_TASK_ROLES = (SceneRole.OBJECT, SceneRole.TARGET)


@final
class SimulatedFrame(FrameLabels):
    """Ground truth of one frame of a recording, pixel by pixel.

    Args:
        recording: the recording.
        frame: number of the frame.
        goal: recording of the same things whose goal :meth:`at_goal` refers to; None for ``recording`` itself.
    """

    def __init__(self, recording: Recording, frame: int, goal: Recording | None = None) -> None:
        self._recording, self._frame = recording, frame
        self._ground_truth = FrameGroundTruth(recording, frame)
        self._goal = recording if goal is None else goal
        # The same features are looked up repeatedly.
        self._known: dict[tuple[object, ...], SurfacePoint | None] = {}
        self._ellipses: dict[tuple[float, ...], tuple[SceneRole, tuple[float, ...]] | None] = {}

    def label(
        self,
        point: tuple[float, float],
        tolerance_px: float = TOLERANCE_PX,
        among: Sequence[SceneRole] = tuple(SceneRole),
    ) -> SceneRole | None:
        """See :meth:`FrameLabels.label`; a region contains the points whose pixels show it."""
        surface_point = self._nearest(point, tolerance_px, among)
        return None if surface_point is None else surface_point.role

    def at_goal(self, coordinates: Sequence[tuple[float, float]]) -> list[tuple[float, float] | None]:
        """See :meth:`FrameLabels.at_goal`."""
        points = [self._nearest(point, TOLERANCE_PX, _TASK_ROLES) for point in coordinates]
        known = [point for point in points if point is not None]
        pixels = iter(goal_pixels(self._goal, known).tolist())
        return [None if point is None else tuple(next(pixels)) for point in points]

    def feature_label(
        self,
        node_type: NodeType,
        coordinates: Sequence[float],
        tolerance_px: float = TOLERANCE_PX,
        among: Sequence[SceneRole] = tuple(SceneRole),
    ) -> SceneRole | None:
        """See :meth:`FrameLabels.feature_label`; an ellipse is on what its outline is on, a plane on what it shows."""
        if node_type is NodeType.CONIC:
            found = self._ellipse_at_goal(tuple(coordinates))
            return found[0] if found is not None and found[0] in among else None
        if node_type is NodeType.PLANE:
            role = plane_role(self._ground_truth, np.array(coordinates, np.float64).reshape(4, 2))
            return role if role in among else None
        x, y = centers(np.array([coordinates], np.float64))[0].tolist()
        return self.label((x, y), tolerance_px, among)

    def feature_at_goal(
        self, node_type: NodeType, coordinates: Sequence[float], space: Sequence[float] | None, in_space: bool
    ) -> tuple[float, ...] | None:
        """See :meth:`FrameLabels.feature_at_goal`."""
        corners = np.array(coordinates, np.float64).reshape(-1, 2)
        if node_type is NodeType.CONIC:
            found = self._ellipse_at_goal(tuple(coordinates))
            return None if found is None or in_space else found[1]
        if node_type is NodeType.PLANE:
            plane = np.array(space or [np.nan], np.float64)
            known = plane_at_goal(self._ground_truth, self._goal, plane, corners) if np.isfinite(plane).all() else None
            if known is None or not in_space:
                return None
            normal, distance = known[1][:3], known[1][3]
            camera = self._recording.view(self._frame).pose
            return (*(camera[:3, :3].T @ normal).tolist(), float(distance + normal @ camera[:3, 3]))
        if not in_space:
            pixels = self.at_goal([(x, y) for x, y in corners.tolist()])
            return None if None in pixels else tuple(value for pixel in pixels if pixel for value in pixel)
        points = [self._nearest((x, y), TOLERANCE_PX, _TASK_ROLES) for x, y in corners.tolist()]
        on_things = [point for point in points if point is not None]
        if len(on_things) < len(points):
            return None
        to_camera = inverse(self._recording.view(self._frame).pose)
        return tuple(transform(to_camera, goal_positions(self._goal, on_things)).ravel().tolist())

    def _ellipse_at_goal(self, ellipse: tuple[float, ...]) -> tuple[SceneRole, tuple[float, ...]] | None:
        if ellipse not in self._ellipses:
            corners = np.array(ellipse, np.float64).reshape(4, 2)
            found = ellipse_at_goal(self._ground_truth, self._goal, corners)
            self._ellipses[ellipse] = None if found is None else (found[0], tuple(found[1].ravel().tolist()))
        return self._ellipses[ellipse]

    @cached_property
    def goal_pixel_m(self) -> float:
        """See :attr:`FrameLabels.goal_pixel_m`."""
        return goal_pixel_m(self._goal)

    def _nearest(
        self, point: tuple[float, float], tolerance_px: float, among: Sequence[SceneRole]
    ) -> SurfacePoint | None:
        key = (point, tolerance_px, tuple(among))
        if key not in self._known:
            self._known[key] = self._search(point, tolerance_px, among)
        return self._known[key]

    def _search(
        self, point: tuple[float, float], tolerance_px: float, among: Sequence[SceneRole]
    ) -> SurfacePoint | None:
        """Return what the point's pixel shows if it has one of the roles, else the nearest pixel of the first role."""
        column, row = round(point[0]), round(point[1])
        offset = (point[0] - column, point[1] - row)
        nearest_first = self._ground_truth.at(np.array([column, row]) + _disk(tolerance_px), offset)
        if nearest_first[0] is not None and nearest_first[0].role in among:
            return nearest_first[0]
        for role in among:
            for candidate in nearest_first:
                if candidate is not None and candidate.role is role:
                    return candidate
        return None


@final
class SimulatedLabels(Labels):
    """Ground truth of all frames of a recording.

    Args:
        recording: the recording.
        name: name of the ground truth, for messages.
    """

    def __init__(self, recording: Recording, name: str) -> None:
        self.name = name
        self._recording = recording

    @property
    def first_frame(self) -> int:
        """See :attr:`Labels.first_frame`."""
        return 0

    @property
    def last_frame(self) -> int:
        """See :attr:`Labels.last_frame`."""
        return len(self._recording) - 1

    def at(self, frame: int) -> SimulatedFrame | None:
        """See :meth:`Labels.at`."""
        return SimulatedFrame(self._recording, frame) if 0 <= frame < len(self._recording) else None

    def require_size(self, image_size: tuple[int, int]) -> None:
        """Raise ValueError unless ``image_size``, width and height in pixels, is that of the recording.

        No InputError as in :meth:`Labels.require_size`, since frames and labels come from one recording.
        """
        expected = (self._recording.intrinsics.width, self._recording.intrinsics.height)
        if image_size != expected:
            raise ValueError(f"{self.name}: the frames are {image_size}; expected {expected}")


def _disk(radius_px: float) -> Int[np.ndarray, "n 2"]:
    """Return the offsets (x, y) of the pixels within a distance, the nearest first."""
    reach = int(radius_px)
    steps = np.arange(-reach, reach + 1)
    offsets = np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2)
    distance = np.linalg.norm(offsets, axis=1)
    order = np.argsort(distance, kind="stable")
    return np.asarray(offsets[order][distance[order] <= radius_px])
