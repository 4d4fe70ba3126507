"""What lies at a pixel of a recording: the role, the body, and the place on that body."""

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
    """A point of a thing's surface.

    Attributes:
        body: name of the body, or of the cloth.
        role: what that part of it is to the task, or None.
        place: the point in the body's frame, or in the cloth's rest state, meters.
    """

    body: str
    role: SceneRole | None
    place: Float64[np.ndarray, "3"]


@final
class FrameTruth:
    """Answers about one frame of a recording.

    Args:
        recording: the recording.
        frame: which of its frames.
    """

    def __init__(self, recording: Recording, frame: int) -> None:
        self.recording = recording
        self.frame = frame

    # Decoded when first asked about, for most frames of a sequence may not be.
    @cached_property
    def _numbers(self) -> Int16[np.ndarray, "height width"]:
        return self.recording.body_numbers(self.frame)

    @cached_property
    def _depth_m(self) -> Float32[np.ndarray, "height width"]:
        return self.recording.depth_m(self.frame)

    def surface(
        self, pixels: Int[np.ndarray, "n 2"], offset: tuple[float, float] = (0.0, 0.0)
    ) -> list[SurfacePoint | None]:
        """What pixels (x, y) show; None outside the picture, and where there is nothing.

        Args:
            pixels: whole pixels.
            offset: how far beside the middles of these pixels the points lie.
        """
        recording = self.recording
        height, width = self._numbers.shape
        inside: Bool[np.ndarray, " n"] = np.all((pixels >= 0) & (pixels < [width, height]), axis=1)
        columns, rows = np.where(inside[:, None], pixels, 0).T
        depth = self._depth_m[rows, columns].astype(np.float64)
        places = np.column_stack([columns, rows]) + np.array(offset, np.float64)
        points = back_project(recording.view(self.frame), places, depth)
        shown = np.where(inside, self._numbers[rows, columns], -2)
        found: list[SurfacePoint | None] = [None] * len(pixels)
        for number in set(shown.tolist()) - {-2}:
            which = np.flatnonzero(shown == number)
            if number == -1:
                assert recording.cloth is not None
                body, places = recording.cloth.name, rest_places(recording.cloth, self.frame, points[which])
            else:
                body = recording.bodies[number]
                places = transform(inverse(recording.poses[self.frame, number]), points[which])
            for index, place in zip(which.tolist(), places, strict=True):
                found[index] = SurfacePoint(body, role_of(recording, body, place), place)
        return found


def role_of(recording: Recording, body: str, place: Float64[np.ndarray, "3"]) -> SceneRole | None:
    """What a point of a body is to the task."""
    for part in recording.roles:
        if part.body == body and np.all(part.lower <= place) and np.all(place <= part.upper):
            return part.role
    return None


def goal_pixels(recording: Recording, points: Sequence[SurfacePoint]) -> Float64[np.ndarray, "n 2"]:
    """Where points of things appear on the last frame, on which the goal is reached; hidden ones too."""
    last = len(recording) - 1
    places = np.array([_in_world(recording, point, last) for point in points]).reshape(-1, 3)
    return project(recording.view(last), places)[0]


def goal_pixel_m(recording: Recording) -> float:
    """The width of a pixel at the object on the last frame."""
    last = len(recording) - 1
    body = next(part.body for part in recording.roles if part.role is SceneRole.OBJECT)
    cloth = recording.cloth
    if cloth is not None and body == cloth.name:
        middle = cloth.vertices[last].mean(axis=0)
    else:
        middle = recording.poses[last, recording.bodies.index(body), :3, 3]
    return float(project(recording.view(last), middle[None])[1][0] / recording.lens.focal_px)


def _in_world(recording: Recording, point: SurfacePoint, frame: int) -> Float64[np.ndarray, "3"]:
    cloth = recording.cloth
    if cloth is not None and point.body == cloth.name:
        return np.asarray(_on_triangles(point.place[None], cloth.rest, cloth.vertices[frame], cloth.triangles)[0])
    number = recording.bodies.index(point.body)
    return np.asarray(transform(recording.poses[frame, number], point.place[None])[0])


def rest_places(cloth: Cloth, frame: int, points: Float64[np.ndarray, "n 3"]) -> Float64[np.ndarray, "n 3"]:
    """Where points of the folded cloth's surface are in its rest state."""
    return _on_triangles(points, cloth.vertices[frame], cloth.rest, cloth.triangles)


def _on_triangles(
    points: Float64[np.ndarray, "n 3"],
    source: Float64[np.ndarray, "v 3"],
    destination: Float64[np.ndarray, "v 3"],
    triangles: Int[np.ndarray, "t 3"],
) -> Float64[np.ndarray, "n 3"]:
    """Points of the nearest triangle of ``source``, carried over to ``destination`` by barycentric coordinates."""
    corners = source[triangles]
    origin, first, second = corners[:, 0], corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    a, b, c = (np.einsum("td,td->t", u, v) for u, v in ((first, first), (first, second), (second, second)))
    determinant = np.maximum(a * c - b * b, 1e-18)
    offset = points[:, None] - origin
    d, e = np.einsum("ntd,td->nt", offset, first), np.einsum("ntd,td->nt", offset, second)
    # Clamped to the triangle, roughly at its corners: enough to tell which one is nearest.
    along = np.clip((c * d - b * e) / determinant, 0, 1)
    across = np.clip((a * e - b * d) / determinant, 0, 1)
    excess = np.maximum(along + across, 1)
    along, across = along / excess, across / excess
    apart = np.linalg.norm(offset - along[..., None] * first - across[..., None] * second, axis=2)
    nearest = apart.argmin(axis=1)
    rows = np.arange(len(points))
    along, across = along[rows, nearest, None], across[rows, nearest, None]
    ends = destination[triangles[nearest]]
    carried: Float64[np.ndarray, "n 3"] = (1 - along - across) * ends[:, 0] + along * ends[:, 1] + across * ends[:, 2]
    return carried
