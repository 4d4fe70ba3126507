"""Ground truth of a recording: which body a pixel shows, at which point, and where that point is at the goal."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import final

import numpy as np
from jaxtyping import Bool, Float32, Float64, Int, Int16

from geoskill.geometry.camera import back_project, project
from geoskill.geometry.poses import inverse, transform
from geoskill.simulation.recording import Cloth, Recording
from geoskill.simulation.roles import SceneRole


@final
@dataclass(frozen=True, eq=False)
class SurfacePoint:
    """A point on the surface of a body.

    Attributes:
        body: name of the body, or of the cloth.
        role: of the body's part at that point, or None.
        position: in the body's frame, or on the cloth at rest, meters.
    """

    body: str
    role: SceneRole | None
    position: Float64[np.ndarray, "3"]


@final
class FrameGroundTruth:
    """Ground truth of one frame of a recording.

    Args:
        recording: the recording.
        frame: index of the frame.
    """

    def __init__(self, recording: Recording, frame: int) -> None:
        self.recording = recording
        self.frame = frame

    # Decoded on first use, since most frames of a sequence may never be queried.
    @cached_property
    def _body_ids(self) -> Int16[np.ndarray, "height width"]:
        return self.recording.body_ids(self.frame)

    @cached_property
    def _depth_m(self) -> Float32[np.ndarray, "height width"]:
        return self.recording.depth_m(self.frame)

    def at(self, pixels: Int[np.ndarray, "n 2"], offset: tuple[float, float] = (0.0, 0.0)) -> list[SurfacePoint | None]:
        """Return the surface point at each pixel; None outside the image and where no body is visible.

        Args:
            pixels: integer pixels (x, y).
            offset: of the points from the centers of these pixels (x, y).
        """
        recording = self.recording
        height, width = self._body_ids.shape
        inside: Bool[np.ndarray, " n"] = np.all((pixels >= 0) & (pixels < [width, height]), axis=1)
        columns, rows = np.where(inside[:, None], pixels, 0).T
        depth = self._depth_m[rows, columns].astype(np.float64)
        subpixels = np.column_stack([columns, rows]) + np.array(offset, np.float64)
        in_world = back_project(recording.view(self.frame), subpixels, depth)
        body_ids = np.where(inside, self._body_ids[rows, columns], -2)
        points: list[SurfacePoint | None] = [None] * len(pixels)
        for body_id in set(body_ids.tolist()) - {-2}:
            indices = np.flatnonzero(body_ids == body_id)
            if body_id == -1:
                assert recording.cloth is not None
                body, positions = recording.cloth.name, rest_positions(recording.cloth, self.frame, in_world[indices])
            else:
                body = recording.bodies[body_id]
                positions = transform(inverse(recording.poses[self.frame, body_id]), in_world[indices])
            for index, position in zip(indices.tolist(), positions, strict=True):
                points[index] = SurfacePoint(body, role_of(recording, body, position), position)
        return points


def role_of(recording: Recording, body: str, position: Float64[np.ndarray, "3"]) -> SceneRole | None:
    """Return the role of a point of a body: that of the first part that contains it, or None."""
    for part in recording.roles:
        if part.body == body and np.all(part.lower <= position) and np.all(position <= part.upper):
            return part.role
    return None


def goal_positions(recording: Recording, points: Sequence[SurfacePoint]) -> Float64[np.ndarray, "n 3"]:
    """Return the positions of points in the world on the last frame, on which the goal is reached, meters."""
    last = len(recording) - 1
    return np.array([_in_world(recording, point, last) for point in points]).reshape(-1, 3)


def goal_pixels(recording: Recording, points: Sequence[SurfacePoint]) -> Float64[np.ndarray, "n 2"]:
    """Return the pixels (x, y) of points on the last frame, whether visible or not; see :func:`goal_positions`."""
    return project(recording.view(len(recording) - 1), goal_positions(recording, points))[0]


def goal_pixel_m(recording: Recording) -> float:
    """Return the width of a pixel at the object's depth on the last frame, meters."""
    last = len(recording) - 1
    body = next(part.body for part in recording.roles if part.role is SceneRole.OBJECT)
    cloth = recording.cloth
    if cloth is not None and body == cloth.name:
        center = cloth.vertices[last].mean(axis=0)
    else:
        center = recording.poses[last, recording.bodies.index(body), :3, 3]
    return float(project(recording.view(last), center[None])[1][0] / recording.intrinsics.focal_px)


def _in_world(recording: Recording, point: SurfacePoint, frame: int) -> Float64[np.ndarray, "3"]:
    cloth = recording.cloth
    if cloth is not None and point.body == cloth.name:
        moved = _map_between_meshes(point.position[None], cloth.rest, cloth.vertices[frame], cloth.triangles)
        return np.asarray(moved[0])
    body_id = recording.bodies.index(point.body)
    return np.asarray(transform(recording.poses[frame, body_id], point.position[None])[0])


def rest_positions(cloth: Cloth, frame: int, points: Float64[np.ndarray, "n 3"]) -> Float64[np.ndarray, "n 3"]:
    """Return the positions on the cloth at rest of points (in the world) on the cloth in a frame."""
    return _map_between_meshes(points, cloth.vertices[frame], cloth.rest, cloth.triangles)


def _map_between_meshes(
    points: Float64[np.ndarray, "n 3"],
    source: Float64[np.ndarray, "v 3"],
    destination: Float64[np.ndarray, "v 3"],
    triangles: Int[np.ndarray, "t 3"],
) -> Float64[np.ndarray, "n 3"]:
    """Map points on the mesh ``source`` to ``destination`` by barycentric coordinates of the nearest triangle."""
    corners = source[triangles]
    origin, first, second = corners[:, 0], corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    a, b, c = (np.einsum("td,td->t", u, v) for u, v in ((first, first), (first, second), (second, second)))
    determinant = np.maximum(a * c - b * b, 1e-18)
    offset = points[:, None] - origin
    d, e = np.einsum("ntd,td->nt", offset, first), np.einsum("ntd,td->nt", offset, second)
    # Clamping to the triangle is only approximate outside its corners, but enough to find the nearest triangle.
    u = np.clip((c * d - b * e) / determinant, 0, 1)
    v = np.clip((a * e - b * d) / determinant, 0, 1)
    excess = np.maximum(u + v, 1)
    u, v = u / excess, v / excess
    distances = np.linalg.norm(offset - u[..., None] * first - v[..., None] * second, axis=2)
    nearest = distances.argmin(axis=1)
    rows = np.arange(len(points))
    u, v = u[rows, nearest, None], v[rows, nearest, None]
    new_corners = destination[triangles[nearest]]
    mapped: Float64[np.ndarray, "n 3"] = (1 - u - v) * new_corners[:, 0] + u * new_corners[:, 1] + v * new_corners[:, 2]
    return mapped
