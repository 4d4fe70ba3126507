"""The ground truth of rendered frames."""

from collections.abc import Sequence
from functools import cached_property
from typing import final

import numpy as np
from jaxtyping import Int

from geoskill.evaluation.labels import TOLERANCE_PX, FrameLabels, Labels, Region
from geoskill.simulation.ground_truth import FrameGroundTruth, SurfacePoint, goal_pixel_m, goal_pixels
from geoskill.simulation.recording import Recording
from geoskill.simulation.roles import SceneRole

REGION_OF = {SceneRole.OBJECT: Region.OBJECT, SceneRole.TARGET: Region.TARGET, SceneRole.AGENT: Region.HAND}


@final
class SimulatedFrame(FrameLabels):
    """What the pixels of one frame show.

    Args:
        recording: the recording.
        frame: which of its frames.
        goal: the recording at whose goal :meth:`at_goal` looks, if not its own; it shows the same things.
    """

    def __init__(self, recording: Recording, frame: int, goal: Recording | None = None) -> None:
        self._truth = FrameGroundTruth(recording, frame)
        self._goal = recording if goal is None else goal
        self._known: dict[tuple[object, ...], SurfacePoint | None] = {}  # the same features are asked about repeatedly

    def label(
        self, point: tuple[float, float], tolerance_px: float = TOLERANCE_PX, among: Sequence[Region] = tuple(Region)
    ) -> Region | None:
        """See :meth:`FrameLabels.label`; a point lies in the region that its pixel shows."""
        found = self._near(point, tolerance_px, among)
        return None if found is None else _region(found)

    def at_goal(self, coordinates: Sequence[tuple[float, float]]) -> list[tuple[float, float] | None]:
        """See :meth:`FrameLabels.at_goal`."""
        points = [self._near(point, TOLERANCE_PX, (Region.OBJECT, Region.TARGET)) for point in coordinates]
        known = [point for point in points if point is not None]
        places = iter(goal_pixels(self._goal, known).tolist())
        return [None if point is None else tuple(next(places)) for point in points]

    @cached_property
    def goal_pixel_m(self) -> float:
        """See :attr:`FrameLabels.goal_pixel_m`."""
        return goal_pixel_m(self._goal)

    def _near(self, point: tuple[float, float], tolerance_px: float, among: Sequence[Region]) -> SurfacePoint | None:
        """What the point's pixel shows if it is of a region, else the nearest such pixel within the tolerance."""
        key = (point, tolerance_px, tuple(among))
        if key not in self._known:
            self._known[key] = self._search(point, tolerance_px, among)
        return self._known[key]

    def _search(self, point: tuple[float, float], tolerance_px: float, among: Sequence[Region]) -> SurfacePoint | None:
        column, row = round(point[0]), round(point[1])
        offset = (point[0] - column, point[1] - row)
        found = self._truth.at(np.array([column, row]) + _disk(tolerance_px), offset)  # the nearest ones first
        if found[0] is not None and _region(found[0]) in among:
            return found[0]
        for region in among:
            for candidate in found:
                if candidate is not None and _region(candidate) is region:
                    return candidate
        return None


@final
class SimulatedLabels(Labels):
    """The ground truth of all frames of a recording.

    Args:
        recording: the recording.
        name: for messages.
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
        """See :meth:`Labels.require_size`; frames and labels come from one recording."""
        expected = (self._recording.intrinsics.width, self._recording.intrinsics.height)
        if image_size != expected:
            raise ValueError(f"{self.name}: the frames are {image_size}; expected {expected}")


def _region(point: SurfacePoint) -> Region | None:
    return None if point.role is None else REGION_OF[point.role]


def _disk(radius_px: float) -> Int[np.ndarray, "n 2"]:
    """Offsets of the pixels within a distance, the nearest first."""
    reach = int(radius_px)
    steps = np.arange(-reach, reach + 1)
    offsets = np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2)
    distance = np.linalg.norm(offsets, axis=1)
    order = np.argsort(distance, kind="stable")
    return np.asarray(offsets[order][distance[order] <= radius_px])
