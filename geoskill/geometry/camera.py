"""The pinhole camera.

A camera's frame has x to the right, y down and z forward, like its pictures; pixel (0, 0) is the center of the top left
pixel. Depth is along the camera's z, not along the ray. Lengths are in meters.
"""

import math
from dataclasses import dataclass
from typing import final

import numpy as np
from jaxtyping import Float64

from geoskill.geometry.poses import Pose, Rotation, Vector, inverse, transform


@final
@dataclass(frozen=True, eq=False)
class PinholeCamera:
    """A camera with square pixels whose axis meets the middle of the picture.

    Attributes:
        width: of the picture in pixels.
        height: likewise.
        focal_px: focal length in pixels.
        pose: of the camera in the world.
    """

    width: int
    height: int
    focal_px: float
    pose: Pose

    @property
    def center_px(self) -> Float64[np.ndarray, "2"]:
        """Where the axis meets the picture."""
        return np.array([(self.width - 1) / 2, (self.height - 1) / 2])


def focal_length_px(height: int, vertical_view_rad: float) -> float:
    """The focal length of a camera that sees ``vertical_view_rad`` from the top to the bottom of ``height`` pixels."""
    return height / 2 / math.tan(vertical_view_rad / 2)


def project(
    camera: PinholeCamera, points: Float64[np.ndarray, "n 3"]
) -> tuple[Float64[np.ndarray, "n 2"], Float64[np.ndarray, " n"]]:
    """Where points of the world appear, in pixels, and their depth; behind the camera the depth is not positive.

    One meter before the camera and 0.1 m to the right of its axis:

    >>> at_origin = PinholeCamera(641, 481, 500.0, np.eye(4))
    >>> project(at_origin, np.array([[0.1, 0.0, 1.0]]))
    (array([[370., 240.]]), array([1.]))
    """
    seen = transform(inverse(camera.pose), points)
    depth = seen[:, 2]
    pixels: Float64[np.ndarray, "n 2"] = camera.focal_px * seen[:, :2] / depth[:, None] + camera.center_px
    return pixels, depth


def back_project(
    camera: PinholeCamera, pixels: Float64[np.ndarray, "n 2"], depth_m: Float64[np.ndarray, " n"]
) -> Float64[np.ndarray, "n 3"]:
    """The points of the world that appear at the pixels, at the given depths; the inverse of :func:`project`."""
    across = (pixels - camera.center_px) / camera.focal_px * depth_m[:, None]
    return transform(camera.pose, np.column_stack([across, depth_m]))


def looking_at(position: Vector, target: Vector, roll_rad: float = 0.0) -> Pose:
    """The pose of a camera that looks from a position at a target, the world's z axis up in the picture.

    Args:
        position: of the camera.
        target: appears in the middle of the picture; not straight above or below the camera.
        roll_rad: by how much the camera is turned about its axis, clockwise as seen from behind it.
    """
    forward = (target - position) / np.linalg.norm(target - position)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    down = np.cross(forward, right)
    cosine, sine = math.cos(roll_rad), math.sin(roll_rad)
    rotation: Rotation = np.column_stack([cosine * right + sine * down, cosine * down - sine * right, forward])
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = rotation, position
    return matrix
