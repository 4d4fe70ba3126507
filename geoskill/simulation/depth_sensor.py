"""Depth as a stereo camera measures it: noise that grows with the square of the distance, and holes."""

from collections.abc import Mapping
from typing import Final

import cv2
import numpy as np
from jaxtyping import Bool, Float32, Float64

from geoskill.geometry.camera import PinholeCamera
from geoskill.geometry.depth_camera import D405_NOISE_PER_M, D435_NOISE_PER_M, DepthCamera
from geoskill.simulation.randomness import generator
from geoskill.simulation.recording import Recording

NOISE_PER_M: Final[Mapping[str, float]] = {"d435": D435_NOISE_PER_M, "d405": D405_NOISE_PER_M, "perfect": 0.0}
"""Standard deviation at 1 m of the sensors that can be chosen."""

SMOOTH_PX: Final = 5
"""A stereo camera compares windows, so that noise is alike within so many pixels."""
MIN_COSINE: Final = 0.2
"""A surface that is seen at a flatter angle is not measured; the cosine is that of its normal and the ray."""
EDGE_PX: Final = 3
"""Nor is what is within so many pixels of an edge, where one camera sees what the other does not."""
EDGE_RATIO: Final = 0.015
"""An edge is a bend or a step of the depth by more than this share of it, 1 cm at 0.7 m, from one pixel to the next."""


def recorded_depth(
    recording: Recording, frame: int, sensor: str, seed: int, episode: str
) -> Float32[np.ndarray, "height width"]:
    """Return what a sensor of :data:`NOISE_PER_M` measures in a frame of a recording; see :func:`sense_depth`.

    Equal arguments give equal depth, whatever other frames are asked for.

    Args:
        recording: the recording.
        frame: index of the frame.
        sensor: name of the sensor.
        seed: of the recording.
        episode: name of the recording.
    """
    rng = generator(seed, "depth", episode, frame)
    return sense_depth(recording.depth_m(frame), recording.view(frame), NOISE_PER_M[sensor], rng)


def depth_camera(camera: PinholeCamera, noise_per_m: float) -> DepthCamera:
    """Return the intrinsics of a camera's pictures, which the depth is aligned with."""
    x, y = camera.center_px.tolist()
    return DepthCamera(camera.focal_px, camera.focal_px, x, y, noise_per_m)


def sense_depth(
    depth_m: Float32[np.ndarray, "height width"],
    camera: PinholeCamera,
    noise_per_m: float,
    rng: np.random.Generator,
) -> Float32[np.ndarray, "height width"]:
    """Return the depth that a sensor measures, meters; NaN where it measures none.

    Args:
        depth_m: the true depth.
        camera: its camera, at any pose.
        noise_per_m: standard deviation of a depth of 1 m; 0 for a perfect sensor, without noise and holes.
        rng: draws the noise.
    """
    if noise_per_m == 0:
        return depth_m.copy()
    noise = cv2.blur(rng.standard_normal(depth_m.shape, np.float32), (SMOOTH_PX, SMOOTH_PX)) * np.float32(SMOOTH_PX)
    std = depth_camera(camera, noise_per_m).depth_std_m(depth_m.astype(np.float64))
    sensed: Float32[np.ndarray, "height width"] = (depth_m + std * noise).astype(np.float32)
    sensed[_holes(depth_m, camera) | (sensed <= 0)] = np.nan
    return sensed


def _holes(depth_m: Float32[np.ndarray, "height width"], camera: PinholeCamera) -> Bool[np.ndarray, "height width"]:
    """Return where nothing is measured: at flat angles and around edges."""
    depth = depth_m.astype(np.float64)
    bend = np.maximum(np.abs(_second_difference(depth, 0)), np.abs(_second_difference(depth, 1)))
    edges = (bend > EDGE_RATIO * depth).astype(np.uint8)
    around = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * EDGE_PX + 1, 2 * EDGE_PX + 1))
    return np.asarray((cv2.dilate(edges, around) > 0) | (_cosine(depth, camera) < MIN_COSINE))


def _second_difference(depth: Float64[np.ndarray, "height width"], axis: int) -> Float64[np.ndarray, "height width"]:
    padded = np.pad(depth, [(1, 1) if own == axis else (0, 0) for own in range(2)], "reflect", reflect_type="odd")
    return np.diff(padded, 2, axis)


def _cosine(depth: Float64[np.ndarray, "height width"], camera: PinholeCamera) -> Float64[np.ndarray, "height width"]:
    """Return the cosine of the angle between the surface's normal and the ray at each pixel.

    With z(u, v) the depth, and u and v counted from the principal point, the surface is z (u / f, v / f, 1), a normal
    is (f z_u, f z_v, -(z + u z_u + v z_v)), and its product with the ray (u / f, v / f, 1) is -z.
    """
    x, y = camera.center_px
    u, v = np.arange(depth.shape[1]) - x, np.arange(depth.shape[0])[:, None] - y
    along_v, along_u = np.gradient(depth)
    normal = camera.focal_px**2 * (along_u**2 + along_v**2) + (depth + u * along_u + v * along_v) ** 2
    ray = 1 + (u**2 + v**2) / camera.focal_px**2
    return np.asarray(np.abs(depth) / np.sqrt(normal * ray))
