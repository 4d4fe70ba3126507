"""Where planes and ellipses of a frame belong: on which body they are, and where they are at the goal.

Points and lines show their surface at every pixel (:class:`~geoskill.simulation.ground_truth.FrameGroundTruth`). A
plane or an ellipse shows it in part: other things may be within the outline of the one, and in front of the other.
"""

from collections import Counter
from collections.abc import Sequence
from typing import Final

import numpy as np
from jaxtyping import Float64

from geoskill.geometry.camera import PinholeCamera, project
from geoskill.geometry.poses import inverse, transform
from geoskill.simulation.ground_truth import FrameGroundTruth, SurfacePoint, goal_positions
from geoskill.simulation.recording import Recording
from geoskill.simulation.roles import SceneRole

NEAR_PLANE_M: Final = 0.010
"""A surface within this distance of a measured plane is what was measured."""
ON_PLANE_M: Final = 0.0015
GRID: Final = 24
"""Within an outline, so many places along either side are looked at."""
SAMPLES, SIDES_PX = 32, (-2.0, 2.0)
"""Along an ellipse, and to either side of it."""
MIN_POINTS: Final = 8

Plane = Float64[np.ndarray, "4"]
"""``[n, d]`` with n·X + d = 0 and n of unit length, meters."""


def plane_role(truth: FrameGroundTruth, outline: Float64[np.ndarray, "4 2"]) -> SceneRole | None:
    """Return the role of the thing that most of a plane's outline shows.

    None, too, for a plane that object and target share, each with a fourth of it at least: nothing is left to bring
    together, and it is on neither more than on the other.

    Args:
        truth: of the frame in which it was measured.
        outline: four corners, pixels.
    """
    counts = Counter(None if surface is None else surface.role for surface in _within(truth, outline))
    fewer, more = sorted((counts[SceneRole.OBJECT], counts[SceneRole.TARGET]))
    (role, most), *_ = counts.most_common(1)
    return None if 3 * fewer >= more and fewer + more > most else role


def plane_at_goal(
    truth: FrameGroundTruth, goal: Recording, plane: Plane, outline: Float64[np.ndarray, "4 2"]
) -> tuple[SceneRole, Plane] | None:
    """Return which thing a measured plane is on, and the true plane at the goal, in the world, toward the camera.

    Args:
        truth: of the frame in which it was measured.
        goal: recording of the same things whose last frame is the goal.
        plane: as measured, in the camera's frame.
        outline: four corners, pixels.

    Returns:
        None when hardly any of it is on the object or the target, or it is on a cloth.
    """
    surfaces = _within(truth, outline)
    to_camera = inverse(truth.recording.view(truth.frame).pose)
    near: list[SurfacePoint] = []
    for surface in surfaces:
        if surface is not None and surface.role in (SceneRole.OBJECT, SceneRole.TARGET):
            position = transform(to_camera, _now(truth, surface))[0] if _is_rigid(truth, surface) else None
            if position is not None and abs(position @ plane[:3] + plane[3]) <= NEAR_PLANE_M:
                near.append(surface)
    own = _most_common(near)
    if len(own) < MIN_POINTS:
        return None
    role = own[0].role
    assert role is not None
    at_goal = _fitted(goal_positions(goal, own))
    camera = goal.view(len(goal) - 1).pose[:3, 3]
    return role, at_goal if camera @ at_goal[:3] + at_goal[3] > 0 else -at_goal


def ellipse_at_goal(
    truth: FrameGroundTruth, goal: Recording, ellipse: Float64[np.ndarray, "4 2"]
) -> tuple[SceneRole, Float64[np.ndarray, "4 2"]] | None:
    """Return which thing an ellipse in the picture is on, and its pixels at the goal.

    It is on the body in whose surface most of its outline lies; what is in front of that surface hides it and does not
    count, what is behind speaks against it. So a rim, which is thin, is on nothing, and a mark is where it is drawn.

    Args:
        truth: of the frame in which it was detected.
        goal: recording of the same things whose last frame is the goal.
        ellipse: the ends of two conjugate diameters, pixels.

    Returns:
        None when hardly any of its outline is on one plane of the object or the target.
    """
    recording, view = truth.recording, truth.recording.view(truth.frame)
    pixels = _around(ellipse)
    known = [
        (pixel, surface)
        for pixel, surface in zip(pixels, truth.at(pixels), strict=True)
        if surface is not None and _is_rigid(truth, surface)
    ]
    if not known:
        return None
    outline = np.array([pixel for pixel, _ in known], np.float64)
    seen = np.concatenate([_now(truth, surface) for _, surface in known])
    best: tuple[int, SurfacePoint, Plane] | None = None
    for name in {surface.body for _, surface in known if surface.role in (SceneRole.OBJECT, SceneRole.TARGET)}:
        rows = [row for row, (_, surface) in enumerate(known) if surface.body == name]
        if len(rows) < MIN_POINTS:
            continue
        plane = _fitted(seen[rows])
        depths = [project(view, points)[1] for points in (seen, _on_plane(view, outline, plane))]
        behind = depths[0] - depths[1]
        on = int((np.abs(behind[rows]) <= 2 * ON_PLANE_M).sum())
        support = on - 2 * int((behind > 2 * ON_PLANE_M).sum())
        if on >= MIN_POINTS and (best is None or support > best[0]):
            best = support, known[rows[0]][1], plane
    if best is None or best[0] <= 0:
        return None
    _, surface, plane = best
    now = recording.poses[truth.frame, recording.bodies.index(surface.body)]
    positions = transform(inverse(now), _on_plane(view, ellipse, plane))
    at_goal = goal_positions(goal, [SurfacePoint(surface.body, surface.role, position) for position in positions])
    assert surface.role is not None
    return surface.role, project(goal.view(len(goal) - 1), at_goal)[0]


def _within(truth: FrameGroundTruth, outline: Float64[np.ndarray, "4 2"]) -> list[SurfacePoint | None]:
    """Return what places all over an outline show."""
    first, second = (values.ravel() for values in np.meshgrid(*[np.linspace(0.02, 0.98, GRID)] * 2))
    weights = np.stack([(1 - first) * (1 - second), first * (1 - second), first * second, (1 - first) * second], axis=1)
    return truth.at(np.round(weights @ outline).astype(np.int64))


def _is_rigid(truth: FrameGroundTruth, surface: SurfacePoint) -> bool:
    cloth = truth.recording.cloth
    return cloth is None or surface.body != cloth.name


def _now(truth: FrameGroundTruth, surface: SurfacePoint) -> Float64[np.ndarray, "1 3"]:
    """Return where a point of a rigid body is in the frame, in the world."""
    body_id = truth.recording.bodies.index(surface.body)
    return transform(truth.recording.poses[truth.frame, body_id], surface.position[None])


def _most_common(surfaces: Sequence[SurfacePoint]) -> list[SurfacePoint]:
    """Return the points of the body and the role that most of them are of."""
    counts = Counter((surface.body, surface.role) for surface in surfaces).most_common(1)
    return [surface for surface in surfaces if (surface.body, surface.role) == counts[0][0]] if counts else []


def _around(ellipse: Float64[np.ndarray, "4 2"]) -> np.ndarray:
    """Return pixels on either side of an ellipse."""
    center = ellipse.mean(axis=0)
    arms = np.stack([ellipse[0] - ellipse[1], ellipse[2] - ellipse[3]]) / 2
    angles = np.linspace(0, 2 * np.pi, SAMPLES, endpoint=False)
    outward = np.column_stack([np.cos(angles), np.sin(angles)]) @ arms
    lengths = np.maximum(np.linalg.norm(outward, axis=1, keepdims=True), 1e-9)
    return np.round(np.concatenate([center + outward * (1 + side / lengths) for side in SIDES_PX])).astype(np.int64)


def _fitted(points: Float64[np.ndarray, "n 3"]) -> Plane:
    """Return the plane of least squares of most of the points: those far from the first one are left out."""
    kept = points
    for _ in range(4):
        center = kept.mean(axis=0)
        normal = np.linalg.svd(kept - center, full_matrices=False)[2][-1]
        distances = np.abs((points - center) @ normal)
        kept = points[distances <= max(ON_PLANE_M, float(np.median(distances)))]
    return np.append(normal, -normal @ center)


def _on_plane(view: PinholeCamera, pixels: Float64[np.ndarray, "n 2"], plane: Plane) -> Float64[np.ndarray, "n 3"]:
    """Return where the rays of pixels meet a plane of the world."""
    rays = np.column_stack([(pixels - view.center_px) / view.focal_px, np.ones(len(pixels))]) @ view.pose[:3, :3].T
    start = view.pose[:3, 3]
    lengths = -(start @ plane[:3] + plane[3]) / (rays @ plane[:3])
    return np.asarray(start + lengths[:, None] * rays)
