"""The paper's hand-designed baseline: ten pairs of points picked on the first frame, and twenty trackers.

Each pair has one point on the object and one on the target, and all of them define the same task. A tracker that is
lost stays lost. As long as one pair still defines the task at the end, the baseline has succeeded (section IV-C).
"""

from dataclasses import dataclass
from typing import final

import cv2
import numpy as np
from jaxtyping import Float32

from geoskill.evaluation.goal import STRICT_M
from geoskill.simulation.ground_truth import FrameTruth, SurfacePoint, goal_pixel_m, goal_pixels
from geoskill.simulation.recording import Recording
from geoskill.simulation.roles import SceneRole
from geoskill.tracking.flow import lucas_kanade

PAIRS = 10
# A tracker that comes back elsewhere when it is run backwards has slipped, in pixels.
SLIP_PX = 1.0
# A tracker that ends farther from its point does not define the task any more: twice what strict accuracy asks.
KEPT_M = 2 * STRICT_M

Points = Float32[np.ndarray, "n 2"]


@final
@dataclass(frozen=True)
class BaselineOutcome:
    """How the trackers ended.

    Attributes:
        picked: pairs that could be picked on the first frame, at most :data:`PAIRS`.
        kept: pairs of which both trackers are still at their points on the last frame.
    """

    picked: int
    kept: int

    @property
    def success(self) -> bool:
        """Whether the task is still defined."""
        return self.kept > 0


def track_hand_picked_pairs(recording: Recording) -> BaselineOutcome:
    """Pick pairs by the ground truth, track them, and see which are left.

    Picked are the strongest corners that the camera sees on the first frame and on the last one, as a person would who
    knows the task.
    """
    first = cv2.cvtColor(recording.picture(0), cv2.COLOR_RGB2GRAY)
    corners = cv2.goodFeaturesToTrack(first, maxCorners=1000, qualityLevel=0.005, minDistance=4)
    pixels = np.zeros((0, 2), np.float32) if corners is None else corners.reshape(-1, 2)  # the strongest first
    surfaces = FrameTruth(recording, 0).surface(np.round(pixels).astype(np.int64))
    known = [place for place, surface in enumerate(surfaces) if surface is not None and surface.role is not None]
    seen = _seen_at_the_end(recording, [surfaces[place] for place in known])
    picked: dict[SceneRole, list[int]] = {SceneRole.OBJECT: [], SceneRole.TARGET: []}
    for place, visible in zip(known, seen, strict=True):
        surface = surfaces[place]
        if visible and surface is not None and surface.role in picked:
            picked[surface.role].append(place)
    pairs = list(zip(picked[SceneRole.OBJECT][:PAIRS], picked[SceneRole.TARGET][:PAIRS], strict=False))
    if not pairs:
        return BaselineOutcome(0, 0)
    chosen = np.array(pairs).T.reshape(-1)
    points, alive = _track(recording, pixels[chosen])
    expected = goal_pixels(recording, [point for place in chosen if (point := surfaces[place]) is not None])
    kept = alive & (np.linalg.norm(points - expected, axis=1) * goal_pixel_m(recording) <= KEPT_M)
    return BaselineOutcome(len(pairs), int((kept[: len(pairs)] & kept[len(pairs) :]).sum()))


def _seen_at_the_end(recording: Recording, surfaces: list[SurfacePoint | None]) -> list[bool]:
    points = [surface for surface in surfaces if surface is not None]
    shown = FrameTruth(recording, len(recording) - 1).surface(np.round(goal_pixels(recording, points)).astype(np.int64))
    return [
        found is not None and found.body == point.body and float(np.linalg.norm(found.place - point.place)) <= STRICT_M
        for point, found in zip(points, shown, strict=True)
    ]


def _track(recording: Recording, points: Points) -> tuple[Points, np.ndarray]:
    """Where the points end by pyramidal Lucas-Kanade, and which of them were never lost."""
    alive = np.ones(len(points), bool)
    before = cv2.cvtColor(recording.picture(0), cv2.COLOR_RGB2GRAY)
    for frame in range(1, len(recording)):
        after = cv2.cvtColor(recording.picture(frame), cv2.COLOR_RGB2GRAY)
        points, consistent = lucas_kanade(points, before, after, SLIP_PX)
        alive &= consistent
        before = after
    return points, alive
