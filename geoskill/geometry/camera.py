"""The pinhole camera.

A camera's frame has x to the right, y down and z forward, like its images; pixel (0, 0) is the center of the top left
pixel. Depth is along the camera's z axis, not along the ray. Lengths are in meters.
"""

import math
from dataclasses import dataclass
from typing import final

import numpy as np
from jaxtyping import Float64

from geoskill.geometry.poses import Pose, RotationMatrix, Vector, inverse, transform


@final
@dataclass(frozen=True, eq=False)
class PinholeCamera:
    """A camera with square pixels, without distortion, whose principal point is the center of the image.

    Attributes:
        width: of the image, pixels.
        height: of the image, pixels.
        focal_px: focal length, pixels.
        pose: of the camera in the world.
    """

    width: int
    height: int
    focal_px: float
    pose: Pose

    @property
    def center_px(self) -> Float64[np.ndarray, "2"]:
        """The principal point (x, y), pixels."""
        return np.array([(self.width - 1) / 2, (self.height - 1) / 2])


def focal_length_px(height: int, vertical_view_rad: float) -> float:
    """Return the focal length that gives a vertical field of view of ``vertical_view_rad`` over ``height`` pixels."""
    return height / 2 / math.tan(vertical_view_rad / 2)


def project(
    camera: PinholeCamera, points: Float64[np.ndarray, "n 3"]
) -> tuple[Float64[np.ndarray, "n 2"], Float64[np.ndarray, " n"]]:
    """Project points of the world into the image.

    A point one meter in front of the camera and 0.1 m to the right of its axis:

    >>> camera = PinholeCamera(641, 481, 500.0, np.eye(4))
    >>> project(camera, np.array([[0.1, 0.0, 1.0]]))
    (array([[370., 240.]]), array([1.]))

    Returns:
        Pixels (x, y), which may lie outside the image, and depths in meters. A point behind the camera has a depth
        that is not positive, and a meaningless pixel.
    """
    in_camera = transform(inverse(camera.pose), points)
    depth = in_camera[:, 2]
    pixels: Float64[np.ndarray, "n 2"] = camera.focal_px * in_camera[:, :2] / depth[:, None] + camera.center_px
    return pixels, depth


def back_project(
    camera: PinholeCamera, pixels: Float64[np.ndarray, "n 2"], depth_m: Float64[np.ndarray, " n"]
) -> Float64[np.ndarray, "n 3"]:
    """Return the points of the world at the given pixels and depths, the inverse of :func:`project`."""
    in_plane = (pixels - camera.center_px) / camera.focal_px * depth_m[:, None]
    return transform(camera.pose, np.column_stack([in_plane, depth_m]))


def look_at(position: Vector, target: Vector, roll_rad: float = 0.0) -> Pose:
    """Return the pose of a camera at a position that looks at a target, with the world's z axis up in the image.

    Args:
        position: of the camera.
        target: the point in the center of the image; not straight above or below the camera.
        roll_rad: rotation of the camera about its optical axis, clockwise as seen from behind the camera.
    """
    forward = (target - position) / np.linalg.norm(target - position)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    down = np.cross(forward, right)
    cosine, sine = math.cos(roll_rad), math.sin(roll_rad)
    rotation: RotationMatrix = np.column_stack([cosine * right + sine * down, cosine * down - sine * right, forward])
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = rotation, position
    return matrix
