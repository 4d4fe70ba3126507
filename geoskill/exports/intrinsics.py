"""The motion field of a camera of which only the intrinsics are known, over the twist of its own frame.

A point at depth Z whose picture is at the normalized (x, y) moves with the camera's twist (v, w), in the camera's
frame, by the interaction matrix::

    L = [-1/Z   0   x/Z  xy   -(1+x²)   y
          0   -1/Z  y/Z  1+y²   -xy    -x].

Here the camera is at rest and the thing is moved by that twist about the camera's center, so its pixels move with
-L, times the focal lengths. Source: Chaumette and Hutchinson, Visual servo control I, 2006, equation 11.
"""

from dataclasses import dataclass
from typing import final

import numpy as np
from jaxtyping import Float64

from geoskill.control.action import Action
from geoskill.control.camera_motion import Depths
from geoskill.control.image_motion import ImageMotion, PointJacobians, Points
from geoskill.geometry.depth_camera import DepthCamera
from geoskill.geometry.depth_picture import DepthPicture


@final
@dataclass(frozen=True, eq=False)
class IntrinsicMotion(ImageMotion):
    """The field of a thing that is moved by a twist of the camera's frame, in the order v, w.

    Attributes:
        camera: intrinsics of the picture.
        depth_of: depths of pixels of the carried thing.
    """

    camera: DepthCamera
    depth_of: Depths

    def jacobian(self, points: Points) -> PointJacobians:
        """See :meth:`ImageMotion.jacobian`."""
        focal = np.array([self.camera.focal_x_px, self.camera.focal_y_px])
        matrices = interaction_matrices(normalized(self.camera, points), self.depth_of(points))
        return np.asarray(-focal[None, :, None] * matrices)

    def observed(self, before: Points, after: Points, action: Action) -> "IntrinsicMotion":
        """Return the same field: the camera is at rest."""
        return self


def normalized(camera: DepthCamera, points: Points) -> Points:
    """Return pixels as normalized coordinates, meters at a depth of 1 m.

    >>> normalized(DepthCamera(500.0, 400.0, 320.0, 240.0), np.array([[370.0, 200.0]]))
    array([[ 0.1, -0.1]])
    """
    center = np.array([camera.center_x_px, camera.center_y_px])
    return np.asarray((points - center) / np.array([camera.focal_x_px, camera.focal_y_px]))


def interaction_matrices(points: Points, depth_m: Float64[np.ndarray, " m"]) -> Float64[np.ndarray, "m 2 6"]:
    """Return the interaction matrices of points, for the twist of the camera.

    On the axis, 2 m away, when the camera moves to the right the point moves to the left:

    >>> interaction_matrices(np.zeros((1, 2)), np.array([2.0]))[0, 0]
    array([-0.5,  0. ,  0. ,  0. , -1. ,  0. ])

    Args:
        points: normalized coordinates.
        depth_m: along the camera's axis.
    """
    x, y = points.T
    matrices = np.zeros((len(points), 2, 6))
    matrices[:, 0, 0] = matrices[:, 1, 1] = -1 / depth_m
    matrices[:, 0, 2], matrices[:, 1, 2] = x / depth_m, y / depth_m
    matrices[:, 0, 3], matrices[:, 1, 3] = x * y, 1 + y**2
    matrices[:, 0, 4], matrices[:, 1, 4] = -(1 + x**2), -x * y
    matrices[:, 0, 5], matrices[:, 1, 5] = y, -x
    return matrices


def measured_depth(picture: DepthPicture, otherwise_m: float) -> Depths:
    """Return the function that looks pixels up in a picture of depth.

    Args:
        picture: of the frame.
        otherwise_m: depth of pixels that have none.
    """
    height, width = picture.depth_m.shape

    def depths(points: Points) -> Float64[np.ndarray, " m"]:
        columns, rows = np.rint(np.clip(points, 0, [width - 1, height - 1])).astype(int).T
        found = picture.depth_m[rows, columns].astype(np.float64)
        return np.where(np.isfinite(found), found, otherwise_m)

    return depths
