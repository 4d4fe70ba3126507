"""Alignment of depth with the pictures of a color camera beside the depth camera."""

import numpy as np
from jaxtyping import Float, Float32, Float64

from geoskill.geometry.depth_camera import DepthCamera


def registered(
    depth_m: Float[np.ndarray, "height width"],
    camera: DepthCamera,
    color_camera: DepthCamera,
    to_color: Float64[np.ndarray, "4 4"],
    color_size: tuple[int, int],
) -> Float32[np.ndarray, "color_height color_width"]:
    """Return depth as the color camera would see it, NaN where no pixel of depth falls.

    Every pixel of depth is a point in space. Of the points on one pixel of color the nearest counts. Where the picture
    of color has more pixels, a point covers a square of as many as its own pixel covers.

    Args:
        depth_m: meters, NaN where there is none.
        camera: intrinsics of the depth.
        color_camera: intrinsics of the pictures.
        to_color: takes points of the depth camera's frame to the color camera's.
        color_size: width and height of the pictures.
    """
    width, height = color_size
    rows, columns = np.nonzero(np.isfinite(depth_m))
    pixels = np.stack([columns, rows], axis=1).astype(np.float64)
    points = camera.back_project(pixels, depth_m[rows, columns].astype(np.float64)) @ to_color[:3, :3].T
    points = points + to_color[:3, 3]
    points = points[points[:, 2] > 0]
    places = color_camera.project(points)
    side = max(1, int(np.ceil(color_camera.focal_x_px / camera.focal_x_px)))
    aligned = np.full(height * width, np.inf, np.float32)
    for down in range(side):
        for right in range(side):
            own = np.floor(places + 0.5 - (side - 1) / 2 + [right, down]).astype(np.int64)
            inside = (own >= 0).all(axis=1) & (own[:, 0] < width) & (own[:, 1] < height)
            flat = own[inside, 1] * width + own[inside, 0]
            np.minimum.at(aligned, flat, points[inside, 2].astype(np.float32))
    return np.where(np.isfinite(aligned), aligned, np.float32(np.nan)).reshape(height, width)
