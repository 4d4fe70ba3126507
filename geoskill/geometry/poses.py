"""Rigid poses in space, as 4x4 matrices.

A pose maps homogeneous coordinates of a body to those of the world (or of a parent body): ``world = pose @ body``.
Lengths are in meters, frames are right-handed, the world's z axis points up, angles are in radians.
"""

import math

import numpy as np
from jaxtyping import Float64

Pose = Float64[np.ndarray, "4 4"]
Rotation = Float64[np.ndarray, "3 3"]
Vector = Float64[np.ndarray, "3"]


def rotation_about(vector: Vector) -> Rotation:
    """Return the rotation by ``norm(vector)`` radians about ``vector``, counterclockwise seen from its tip (Rodrigues).

    The zero vector gives the identity. A quarter turn about z takes x to y:

    >>> rotation_about(np.array([0, 0, math.pi / 2])).round(6)[:, 0]
    array([0., 1., 0.])
    """
    angle = float(np.linalg.norm(vector))
    if angle == 0.0:
        return np.eye(3)
    x, y, z = vector / angle
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    rotation: Rotation = np.eye(3) + math.sin(angle) * cross + (1 - math.cos(angle)) * (cross @ cross)
    return rotation


def rotation_vector(rotation: Rotation) -> Vector:
    """Return the rotation vector of a rotation matrix, the inverse of :func:`rotation_about`.

    Its norm is at most pi. A half turn has two such vectors; either may be returned.
    """
    skew = 0.5 * np.array(
        [rotation[2, 1] - rotation[1, 2], rotation[0, 2] - rotation[2, 0], rotation[1, 0] - rotation[0, 1]]
    )
    angle = math.atan2(float(np.linalg.norm(skew)), (float(np.trace(rotation)) - 1) / 2)
    if angle < math.pi - 1e-4:
        vector: Vector = skew if angle < 1e-8 else skew * (angle / math.sin(angle))
        return vector
    # Near a half turn the skew part vanishes. The symmetric part, (1 - cos) axis axis' + cos, stays accurate.
    outer = (rotation + rotation.T) / 2 - math.cos(angle) * np.eye(3)
    column = outer[:, int(np.argmax(np.diag(outer)))]
    axis = column / np.linalg.norm(column)
    return np.asarray(axis * math.copysign(angle, 1.0 if axis @ skew >= 0 else -1.0))


def pose(position: Vector | tuple[float, float, float], rotation: Rotation | None = None) -> Pose:
    """Return the pose of a body at a position; without a rotation, its axes are parallel to the parent's."""
    matrix = np.eye(4)
    matrix[:3, 3] = position
    if rotation is not None:
        matrix[:3, :3] = rotation
    return matrix


def table_pose(x: float, y: float, yaw_rad: float, z: float = 0.0) -> Pose:
    """Return the pose of an upright body on the table, turned by ``yaw_rad`` about the vertical."""
    return pose((x, y, z), rotation_about(np.array([0.0, 0.0, yaw_rad])))


def inverse(matrix: Pose) -> Pose:
    """Return the inverse of a pose, from the transposed rotation, without a matrix inversion."""
    transposed = matrix[:3, :3].T
    return pose(-transposed @ matrix[:3, 3], transposed)


def transform(matrix: Pose, points: Float64[np.ndarray, "n 3"]) -> Float64[np.ndarray, "n 3"]:
    """Transform points from the body's frame to the world's.

    >>> transform(pose((1.0, 0.0, 0.0)), np.array([[0.0, 2.0, 0.0]]))
    array([[1., 2., 0.]])
    """
    transformed: Float64[np.ndarray, "n 3"] = points @ matrix[:3, :3].T + matrix[:3, 3]
    return transformed


def quaternion(rotation: Rotation) -> Float64[np.ndarray, "4"]:
    """Return the unit quaternion (w, x, y, z) of a rotation, with nonnegative w, as MuJoCo orders it."""
    vector = rotation_vector(rotation)
    angle = float(np.linalg.norm(vector))
    axis = vector / angle if angle > 0 else vector
    return np.array([math.cos(angle / 2), *(math.sin(angle / 2) * axis)])
