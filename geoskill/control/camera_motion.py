"""The motion field of a calibrated camera.

For a thing that is moved about the grip G by the twist (v, w) of the world, a point P of it at depth Z, whose picture
is at the normalized (x, y), moves with::

    J = f / Z [1 0 -x; 0 1 -y] R' [I, -[P - G]x],

R the camera's axes in the world. Depth is needed roughly only: with an error of 20 % the loop still converges.
Source: Chaumette and Hutchinson, Visual servo control I, 2006, with the camera at rest and the thing moved.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import final

import numpy as np
from jaxtyping import Float64

from geoskill.control.action import Action, ActionSpace
from geoskill.control.image_motion import ImageMotion, PointJacobians, Points
from geoskill.geometry.camera import PinholeCamera, back_project

Depths = Callable[[Points], Float64[np.ndarray, " m"]]
"""Function from pixels to depths along the camera's axis, meters."""


@final
@dataclass(frozen=True, eq=False)
class CameraMotion(ImageMotion):
    """The field of a camera whose focal length and pose are known, and of a grip whose place is known.

    Attributes:
        camera: with its pose in the base of the robot.
        space: what is commanded.
        grip: position of the tool point in the base, meters.
        depth_of: depths of pixels of the carried thing.
    """

    camera: PinholeCamera
    space: ActionSpace
    grip: Float64[np.ndarray, "3"]
    depth_of: Depths

    def jacobian(self, points: Points) -> PointJacobians:
        """See :meth:`ImageMotion.jacobian`."""
        depths = self.depth_of(points)
        in_world = back_project(self.camera, points, depths)
        return np.asarray(point_jacobians(self.camera, in_world, self.grip) @ self.space.basis)

    def observed(self, before: Points, after: Points, action: Action) -> "CameraMotion":
        """Return the field with the grip where the action has brought it; what was seen is not needed."""
        return replace(self, grip=self.grip + (self.space.basis @ action)[:3])


def point_jacobians(
    camera: PinholeCamera, points: Float64[np.ndarray, "m 3"], grip: Float64[np.ndarray, "3"]
) -> Float64[np.ndarray, "m 2 6"]:
    """Return the derivative of the pixels of points of a moved thing with respect to its twist about the grip.

    A point on the axis, half a meter away, of a camera that looks along z; 1 mm to the right is 1 px at f = 500:

    >>> camera = PinholeCamera(641, 481, 500.0, np.eye(4))
    >>> point_jacobians(camera, np.array([[0.0, 0.0, 0.5]]), np.array([0.0, 0.0, 0.5]))[0, :, :3]
    array([[1000.,    0.,   -0.],
           [   0., 1000.,   -0.]])

    Args:
        camera: at rest.
        points: of the thing, in the world, meters.
        grip: about which the twist turns it.
    """
    rotation = camera.pose[:3, :3]
    in_camera = (points - camera.pose[:3, 3]) @ rotation
    depth = in_camera[:, 2]
    projection = np.zeros((len(points), 2, 3))
    projection[:, 0, 0] = projection[:, 1, 1] = camera.focal_px / depth
    projection[:, :, 2] = -camera.focal_px * in_camera[:, :2] / depth[:, None] ** 2
    moved = np.concatenate([np.repeat(np.eye(3)[None], len(points), axis=0), -cross_matrices(points - grip)], axis=2)
    jacobians: Float64[np.ndarray, "m 2 6"] = projection @ rotation.T @ moved
    return jacobians


def cross_matrices(vectors: Float64[np.ndarray, "m 3"]) -> Float64[np.ndarray, "m 3 3"]:
    """Return the matrices that take the cross product with each vector from the left."""
    matrices = np.zeros((len(vectors), 3, 3))
    matrices[:, [2, 0, 1], [1, 2, 0]] = vectors
    matrices[:, [1, 2, 0], [2, 0, 1]] = -vectors
    return matrices


def constant_depth(depth_m: float) -> Depths:
    """Return the function that gives every pixel the same depth."""
    return lambda points: np.full(len(points), depth_m)
