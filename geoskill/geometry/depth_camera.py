"""The camera of a depth picture: its intrinsics, and the noise of its depth.

Depth is along the camera's axis, in meters; points of the camera's frame have x to the right, y down and z forward.
"""

import math
from dataclasses import dataclass
from typing import Final, final

import numpy as np
from jaxtyping import Float

STEREO_MATCH_STD_PX: Final = 0.08
"""Standard deviation with which a stereo camera finds a point in its second picture, in pixels."""
D435_NOISE_PER_M: Final = STEREO_MATCH_STD_PX / (436.0 * 0.050)
"""Noise of an Intel RealSense D435 at 848x480: focal length 436 px, baseline 50 mm; 1.8 mm at 0.7 m."""
D405_NOISE_PER_M: Final = STEREO_MATCH_STD_PX / (436.0 * 0.018)
"""Noise of an Intel RealSense D405, of the same field of view and a baseline of 18 mm; 1.2 mm at 0.35 m."""


@final
@dataclass(frozen=True)
class DepthCamera:
    """The intrinsics of a picture that depth is aligned with, without distortion.

    Attributes:
        focal_x_px: focal length in pixels, along a row.
        focal_y_px: focal length in pixels, along a column.
        center_x_px: column of the principal point; that of the top left pixel's center is 0.
        center_y_px: row of the principal point.
        noise_per_m: standard deviation of a depth of 1 m, which grows with the square of the depth, as that of a
            stereo camera does; 0 for exact depth.

    Raises:
        ValueError: when a number is not finite, a focal length not positive, or the noise negative.
    """

    focal_x_px: float
    focal_y_px: float
    center_x_px: float
    center_y_px: float
    noise_per_m: float = D435_NOISE_PER_M

    def __post_init__(self) -> None:
        for name in ("focal_x_px", "focal_y_px", "center_x_px", "center_y_px", "noise_per_m"):
            value = getattr(self, name)
            if not math.isfinite(value):
                raise ValueError(f"{name}={value}: expected a finite number")
        if min(self.focal_x_px, self.focal_y_px) <= 0 or self.noise_per_m < 0:
            raise ValueError(
                f"focal lengths {self.focal_x_px:g} and {self.focal_y_px:g} px, noise {self.noise_per_m:g}; expected"
                " focal lengths above 0 and no negative noise"
            )

    def depth_std_m(self, depth_m: Float[np.ndarray, "*shape"]) -> Float[np.ndarray, "*shape"]:
        """Return the standard deviation of depths, meters.

        >>> DepthCamera(600.0, 600.0, 319.5, 239.5, noise_per_m=0.004).depth_std_m(np.array([0.5, 1.0]))
        array([0.001, 0.004])
        """
        std: np.ndarray = self.noise_per_m * np.square(depth_m)
        return std

    def back_project(
        self, pixels: Float[np.ndarray, "*shape 2"], depth_m: Float[np.ndarray, "*shape"]
    ) -> Float[np.ndarray, "*shape 3"]:
        """Return the points of the camera's frame at pixels (x, y) and depths, meters; NaN where the depth is.

        >>> DepthCamera(500.0, 500.0, 320.0, 240.0).back_project(np.array([[370.0, 240.0]]), np.array([2.0]))
        array([[0.2, 0. , 2. ]])
        """
        x = (pixels[..., 0] - self.center_x_px) / self.focal_x_px * depth_m
        y = (pixels[..., 1] - self.center_y_px) / self.focal_y_px * depth_m
        return np.stack([x, y, depth_m], axis=-1)

    def project(self, points: Float[np.ndarray, "*shape 3"]) -> Float[np.ndarray, "*shape 2"]:
        """Return the pixels (x, y) of points of the camera's frame, the inverse of :meth:`back_project`.

        A point behind the camera has a meaningless pixel.
        """
        x = self.focal_x_px * points[..., 0] / points[..., 2] + self.center_x_px
        y = self.focal_y_px * points[..., 1] / points[..., 2] + self.center_y_px
        return np.stack([x, y], axis=-1)
