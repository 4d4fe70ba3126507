"""Hand-designed baseline of the paper (section IV-C): ten pairs of points picked on the first frame, and trackers.

Each pair has one point on the object and one on the target, and every pair alone defines the task. A tracker that is
lost stays lost. The baseline succeeds when at least one pair still defines the task at the end.
"""

from dataclasses import dataclass
from typing import final

import cv2
import numpy as np
from jaxtyping import Bool, Float32

from geoskill.evaluation.goal import STRICT_M
from geoskill.simulation.ground_truth import FrameGroundTruth, SurfacePoint, goal_pixel_m, goal_pixels
from geoskill.simulation.recording import Recording
from geoskill.simulation.roles import SceneRole
from geoskill.tracking.flow import lucas_kanade

PAIRS = 10
# Largest distance in pixels between a point and itself after tracking forward and backward; beyond it, it has slipped.
SLIP_PX = 1.0
# Largest distance between a tracker and its point at the end at which it still defines the task: twice strict
# accuracy's.
KEPT_M = 2 * STRICT_M

Points = Float32[np.ndarray, "n 2"]


@final
@dataclass(frozen=True)
class BaselineOutcome:
    """Numbers of pairs at the start and at the end.

    Attributes:
        picked: pairs that could be picked on the first frame, at most :data:`PAIRS`.
        kept: pairs of which both trackers are still at their points on the last frame.
    """

    picked: int
    kept: int

    @property
    def success(self) -> bool:
        """Whether the task is still defined at the end."""
        return self.kept > 0


def track_hand_picked_pairs(recording: Recording) -> BaselineOutcome:
    """Pick pairs by the ground truth on the first frame, track them, and count those left on the last frame.

    The picks are the strongest corners that are visible on the first and on the last frame, as a person who knows the
    task would choose them.
    """
    first_gray = cv2.cvtColor(recording.picture(0), cv2.COLOR_RGB2GRAY)
    corners = cv2.goodFeaturesToTrack(first_gray, maxCorners=1000, qualityLevel=0.005, minDistance=4)
    pixels = np.zeros((0, 2), np.float32) if corners is None else corners.reshape(-1, 2)  # the strongest first
    surfaces = FrameGroundTruth(recording, 0).at(np.round(pixels).astype(np.int64))
    on_role = [index for index, surface in enumerate(surfaces) if surface is not None and surface.role is not None]
    visible_at_end = _visible_at_end(recording, [surfaces[index] for index in on_role])
    picked: dict[SceneRole, list[int]] = {SceneRole.OBJECT: [], SceneRole.TARGET: []}
    for index, visible in zip(on_role, visible_at_end, strict=True):
        surface = surfaces[index]
        if visible and surface is not None and surface.role in picked:
            picked[surface.role].append(index)
    pairs = list(zip(picked[SceneRole.OBJECT][:PAIRS], picked[SceneRole.TARGET][:PAIRS], strict=False))
    if not pairs:
        return BaselineOutcome(0, 0)
    chosen = np.array(pairs).T.reshape(-1)
    points, alive = _track(recording, pixels[chosen])
    expected = goal_pixels(recording, [point for index in chosen if (point := surfaces[index]) is not None])
    kept = alive & (np.linalg.norm(points - expected, axis=1) * goal_pixel_m(recording) <= KEPT_M)
    return BaselineOutcome(len(pairs), int((kept[: len(pairs)] & kept[len(pairs) :]).sum()))


def _visible_at_end(recording: Recording, surfaces: list[SurfacePoint | None]) -> list[bool]:
    points = [surface for surface in surfaces if surface is not None]
    shown = FrameGroundTruth(recording, len(recording) - 1).at(
        np.round(goal_pixels(recording, points)).astype(np.int64)
    )
    return [
        seen is not None
        and seen.body == point.body
        and float(np.linalg.norm(seen.position - point.position)) <= STRICT_M
        for point, seen in zip(points, shown, strict=True)
    ]


def _track(recording: Recording, points: Points) -> tuple[Points, Bool[np.ndarray, " n"]]:
    """Return the points on the last frame by pyramidal Lucas-Kanade, and whether each was never lost on the way."""
    alive = np.ones(len(points), bool)
    before = cv2.cvtColor(recording.picture(0), cv2.COLOR_RGB2GRAY)
    for frame in range(1, len(recording)):
        after = cv2.cvtColor(recording.picture(frame), cv2.COLOR_RGB2GRAY)
        points, consistent = lucas_kanade(points, before, after, SLIP_PX)
        alive &= consistent
        before = after
    return points, alive
