"""Rigid poses in space, as 4x4 matrices.

A pose maps homogeneous coordinates of a body to those of the world (or of a parent body): ``world = pose @ body``.
Lengths are in meters, frames are right-handed, the world's z axis points up, angles are in radians.
"""

import numpy as np
from jaxtyping import Float64
from scipy.spatial.transform import Rotation

Pose = Float64[np.ndarray, "4 4"]
RotationMatrix = Float64[np.ndarray, "3 3"]
Vector = Float64[np.ndarray, "3"]


def rotation_about(vector: Vector) -> RotationMatrix:
    """Return the rotation by ``norm(vector)`` radians about ``vector``, counterclockwise seen from its tip.

    The zero vector gives the identity. A quarter turn about z takes x to y:

    >>> rotation_about(np.array([0, 0, np.pi / 2])).round(6)[:, 0]
    array([0., 1., 0.])
    """
    return np.asarray(Rotation.from_rotvec(vector).as_matrix())


def rotation_vector(rotation: RotationMatrix) -> Vector:
    """Return the rotation vector of a rotation matrix, the inverse of :func:`rotation_about`.

    Its norm is at most pi. A half turn has two such vectors; either may be returned.
    """
    return np.asarray(Rotation.from_matrix(rotation).as_rotvec())


def pose(position: Vector | tuple[float, float, float], rotation: RotationMatrix | None = None) -> Pose:
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


def quaternion(rotation: RotationMatrix) -> Float64[np.ndarray, "4"]:
    """Return the unit quaternion (w, x, y, z) of a rotation, with nonnegative w, as MuJoCo orders it."""
    x, y, z, w = Rotation.from_matrix(rotation).as_quat(canonical=True)
    return np.array([w, x, y, z])
