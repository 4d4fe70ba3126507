"""A picture of depth with its camera."""

from dataclasses import dataclass, replace
from typing import final

import cv2
import numpy as np
from jaxtyping import Float

from geoskill.geometry.depth_camera import DepthCamera


@final
@dataclass(frozen=True, eq=False)
class DepthPicture:
    """Depth of each pixel of a color picture.

    Attributes:
        depth_m: distance from the camera along its axis, in meters; NaN where there is none.
        camera: intrinsics of the picture.
    """

    depth_m: Float[np.ndarray, "height width"]
    camera: DepthCamera

    def mirrored(self) -> "DepthPicture":
        """Return the depth of the picture mirrored left to right, with the camera that would see it."""
        width = self.depth_m.shape[1]
        camera = replace(self.camera, center_x_px=width - 1 - self.camera.center_x_px)
        return DepthPicture(np.ascontiguousarray(self.depth_m[:, ::-1]), camera)

    def resized(self, width: int, height: int) -> "DepthPicture":
        """Return the depth of the picture resized; that of the nearest pixel, since a mean would mix surfaces."""
        if (height, width) == self.depth_m.shape:
            return self
        x, y = width / self.depth_m.shape[1], height / self.depth_m.shape[0]
        camera = replace(
            self.camera,
            focal_x_px=x * self.camera.focal_x_px,
            focal_y_px=y * self.camera.focal_y_px,
            # A resize keeps the edges of pixels, not their centers, in place.
            center_x_px=x * (self.camera.center_x_px + 0.5) - 0.5,
            center_y_px=y * (self.camera.center_y_px + 0.5) - 0.5,
        )
        depth_m = cv2.resize(self.depth_m, (width, height), interpolation=cv2.INTER_NEAREST_EXACT)
        return DepthPicture(np.asarray(depth_m), camera)
