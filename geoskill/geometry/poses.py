"""Rigid poses in space, as 4x4 matrices.

A pose takes homogeneous coordinates of a body to those of the world (or of a parent body): ``world = pose @ body``.
Lengths are in meters, frames right-handed, the world's z axis points up, angles are in radians.
"""

import math

import numpy as np
from jaxtyping import Float64

Pose = Float64[np.ndarray, "4 4"]
Rotation = Float64[np.ndarray, "3 3"]
Vector = Float64[np.ndarray, "3"]


def rotation_about(vector: Vector) -> Rotation:
    """The rotation by ``norm(vector)`` radians about ``vector``, counterclockwise seen from its tip (Rodrigues).

    A quarter turn about z takes x to y:

    >>> rotation_about(np.array([0, 0, math.pi / 2])).round(6)[:, 0]
    array([0., 1., 0.])
    """
    angle = float(np.linalg.norm(vector))
    if angle == 0.0:
        return np.eye(3)
    x, y, z = vector / angle
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    turned: Rotation = np.eye(3) + math.sin(angle) * cross + (1 - math.cos(angle)) * (cross @ cross)
    return turned


def rotation_vector(rotation: Rotation) -> Vector:
    """The inverse of :func:`rotation_about`, of norm up to pi; at half a turn either of the two vectors."""
    skew = 0.5 * np.array(
        [rotation[2, 1] - rotation[1, 2], rotation[0, 2] - rotation[2, 0], rotation[1, 0] - rotation[0, 1]]
    )
    angle = math.atan2(float(np.linalg.norm(skew)), (float(np.trace(rotation)) - 1) / 2)
    if angle < math.pi - 1e-4:
        vector: Vector = skew if angle < 1e-8 else skew * (angle / math.sin(angle))
        return vector
    # At half a turn the skew part vanishes; the symmetric part is then (1 - cos) axis axis' + cos, and stays exact.
    outer = (rotation + rotation.T) / 2 - math.cos(angle) * np.eye(3)
    column = outer[:, int(np.argmax(np.diag(outer)))]
    axis = column / np.linalg.norm(column)
    return np.asarray(axis * math.copysign(angle, 1.0 if axis @ skew >= 0 else -1.0))


def pose(position: Vector | tuple[float, float, float], rotation: Rotation | None = None) -> Pose:
    """The pose of a body at a position; unturned without a rotation."""
    matrix = np.eye(4)
    matrix[:3, 3] = position
    if rotation is not None:
        matrix[:3, :3] = rotation
    return matrix


def table_pose(x: float, y: float, yaw_rad: float, z: float = 0.0) -> Pose:
    """The pose of a thing that stands upright, turned by ``yaw_rad`` about the vertical."""
    return pose((x, y, z), rotation_about(np.array([0.0, 0.0, yaw_rad])))


def inverse(matrix: Pose) -> Pose:
    """The inverse of a pose, which needs no matrix inversion."""
    turned = matrix[:3, :3].T
    return pose(-turned @ matrix[:3, 3], turned)


def transform(matrix: Pose, points: Float64[np.ndarray, "n 3"]) -> Float64[np.ndarray, "n 3"]:
    """Points of the body in coordinates of the world.

    >>> transform(pose((1.0, 0.0, 0.0)), np.array([[0.0, 2.0, 0.0]]))
    array([[1., 2., 0.]])
    """
    moved: Float64[np.ndarray, "n 3"] = points @ matrix[:3, :3].T + matrix[:3, 3]
    return moved


def quaternion(rotation: Rotation) -> Float64[np.ndarray, "4"]:
    """The unit quaternion w, x, y, z of a rotation, with w not negative."""
    vector = rotation_vector(rotation)
    angle = float(np.linalg.norm(vector))
    axis = vector / angle if angle > 0 else vector
    return np.array([math.cos(angle / 2), *(math.sin(angle / 2) * axis)])
