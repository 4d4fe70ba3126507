"""From the picture to space: points and lines with the depth of their pixels, and the covariance of the result.

A point takes the 20 % quantile of the depths around it, since a corner belongs to what is in front. A line is fitted to
the depths along it: on either side of an edge lie different surfaces, and the edge is that of the nearer one. What has
no depth, or none that fits, is NaN.
"""

from itertools import combinations
from typing import Final

import numpy as np
from jaxtyping import Bool, Float, Float32, Float64

from geoskill.geometry.depth_picture import DepthPicture
from geoskill.geometry.primitives import NodeType
from geoskill.geometry.uncertainty import DETECTION_STD_PX

WINDOW_PX: Final = 2
"""A point looks at so many pixels on every side."""
NEAR_QUANTILE: Final = 0.2
MIN_VALID: Final = 6
"""Of the 25 depths around a point, so many have to be known."""
SAMPLES: Final = 16
"""Places along a line."""
SIDE_PX: Final = 3.0
"""So far to the left and to the right of a line its depth is read."""
INLIER_STD: Final = 3.0
"""A sample is on a line within so many standard deviations of its depth."""
MIN_INLIERS: Final = 8
MIN_COVER: Final = 0.6
"""Samples on the line have to cover more than this share of it."""
DRAWS: Final = 32
PLANE_SIDE: Final = 16
"""Of an outline, a grid of so many places along either side is looked at."""
MIN_PLANE_SHARE: Final = 0.4
"""So many of them have to be on the plane."""
PLANE_FITS: Final = 3
"""Fits of a plane, each to what is near the one before."""
INDEPENDENT_PX2: Final = 56.0
"""Pixels for each independent depth: 4 pi s², with noise smoothed by a Gaussian whose width at half maximum is 5."""
MIN_EXACT_M: Final = 1e-3
"""Points of an exact camera are this close to their plane."""
# Pairs of samples at some distance: nearer ones hardly give a direction. The same ones for all lines and calls.
_PAIRS: Final = np.random.default_rng(0).permutation(
    [pair for pair in combinations(range(SAMPLES), 2) if pair[1] - pair[0] >= SAMPLES // 4]
)[:DRAWS]


def lift(
    node_type: NodeType, geometry: Float32[np.ndarray, "n g"], picture: DepthPicture
) -> tuple[Float32[np.ndarray, "n s"], Float32[np.ndarray, "n s s"]]:
    """Return features in space, in meters, and their covariance in square meters; NaN where there is no depth.

    A plane is fitted to the depths within its outline. Conics are in pictures only.

    Args:
        node_type: type of the features.
        geometry: in pixels of the picture.
        picture: its depth.
    """
    if node_type is NodeType.POINT:
        space, covariance = lift_points(geometry, picture)
    elif node_type is NodeType.LINE:
        space, covariance = lift_lines(geometry, picture)
    elif node_type is NodeType.PLANE:
        space, covariance = lift_planes(geometry, picture)
    else:
        space, covariance = np.zeros((len(geometry), 0)), np.zeros((len(geometry), 0, 0))
    return space.astype(np.float32), covariance.astype(np.float32)


def lift_points(
    points: Float[np.ndarray, "n 2"], picture: DepthPicture
) -> tuple[Float64[np.ndarray, "n 3"], Float64[np.ndarray, "n 3 3"]]:
    """Return points in space with their covariance: that of the pixel, and that of the depth; see :func:`lift`."""
    steps = np.arange(-WINDOW_PX, WINDOW_PX + 1)
    columns = np.round(points[:, 0, None, None]).astype(np.int64) + steps
    rows = np.round(points[:, 1, None, None]).astype(np.int64) + steps[:, None]
    depths = np.sort(_depth_at(picture, columns, rows).reshape(len(points), len(steps) ** 2), axis=1)  # NaN come last
    valid = np.isfinite(depths).sum(axis=1)
    place = NEAR_QUANTILE * np.maximum(valid - 1, 0)
    below = place.astype(np.int64)
    every = np.arange(len(points))
    lower, upper = depths[every, below], depths[every, np.minimum(below + 1, depths.shape[1] - 1)]
    depth = np.where(valid >= MIN_VALID, lower + (place - below) * np.where(place > below, upper - lower, 0.0), np.nan)
    space = picture.camera.back_project(points.astype(np.float64), depth)
    return space, _point_covariance(space, picture)


def lift_lines(
    segments: Float[np.ndarray, "n 4"], picture: DepthPicture
) -> tuple[Float64[np.ndarray, "n 6"], Float64[np.ndarray, "n 6 6"]]:
    """Return lines in space, whose ends correspond to those in the picture, with covariance; see :func:`lift`.

    The ends are the points of the fitted line that are nearest to the rays of the ends in the picture.
    """
    count = len(segments)
    if count == 0:
        return np.zeros((0, 6)), np.zeros((0, 6, 6))
    ends = segments.astype(np.float64).reshape(count, 2, 2)
    samples = _line_samples(ends, picture)
    inside = _most_inliers(samples, picture)
    total = inside.sum(axis=1)
    places = np.where(inside, np.arange(SAMPLES), -1)
    first = np.where(inside, np.arange(SAMPLES), SAMPLES).min(axis=1)
    covered = (places.max(axis=1) - first) / (SAMPLES - 1)
    exists = (total >= MIN_INLIERS) & (covered > MIN_COVER)
    middle, along = _fitted_lines(samples, inside, exists)
    rays = picture.camera.back_project(ends, np.ones((count, 2)))
    space = np.stack([_nearest_to_ray(middle, along, rays[:, end]) for end in range(2)], axis=1)
    space[~exists] = np.nan
    return space.reshape(count, 6), _line_covariance(space, np.maximum(total, 1), picture)


def lift_planes(
    outlines: Float[np.ndarray, "n 8"], picture: DepthPicture
) -> tuple[Float64[np.ndarray, "n 4"], Float64[np.ndarray, "n 4 4"]]:
    """Return the planes that most of the depths within outlines lie in, with covariance; see :func:`lift`.

    An outline is a box around the pixels of a plane and holds others, too.
    """
    space, covariance = np.full((len(outlines), 4), np.nan), np.full((len(outlines), 4, 4), np.nan)
    first, second = np.meshgrid(*[np.linspace(0.05, 0.95, PLANE_SIDE)] * 2)
    weights = np.stack([(1 - first) * (1 - second), first * (1 - second), first * second, (1 - first) * second])
    for row, corners in enumerate(outlines.reshape(-1, 4, 2).astype(np.float64)):
        pixels = np.round(np.tensordot(weights.reshape(4, -1), corners, axes=(0, 0)))
        depths = _depth_at(picture, pixels[:, 0].astype(np.int64), pixels[:, 1].astype(np.int64))
        points = picture.camera.back_project(pixels, depths)
        tolerance = INLIER_STD * picture.camera.depth_std_m(depths) + MIN_EXACT_M
        known = np.isfinite(depths)
        plane = most_common_plane(points[known], tolerance[known])
        if plane is None:
            continue
        pixels_each = _area(corners) / len(points)
        for _ in range(PLANE_FITS):
            near = np.abs(points[known] @ plane[:3] + plane[3]) <= tolerance[known]
            if near.sum() < MIN_PLANE_SHARE * len(points):
                break
            plane, own = fitted_plane(points[known][near], picture, min(1.0, pixels_each / INDEPENDENT_PX2))
            space[row], covariance[row] = plane, own
    return space, covariance


def most_common_plane(
    points: Float64[np.ndarray, "p 3"], tolerance: Float64[np.ndarray, " p"]
) -> Float64[np.ndarray, "4"] | None:
    """Return of some planes through three of the points the one that most are on, or None with too few points."""
    if len(points) < 3:
        return None
    corners = points[np.random.default_rng(0).integers(len(points), size=(DRAWS, 3))]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    lengths = np.linalg.norm(normals, axis=1)
    usable = lengths > 0
    if not usable.any():
        return None
    normals = normals[usable] / lengths[usable, None]
    offsets = -(normals * corners[usable, 0]).sum(axis=1)
    best = int((np.abs(points @ normals.T + offsets) <= tolerance[:, None]).sum(axis=0).argmax())
    return np.append(normals[best], offsets[best])


def fitted_plane(
    points: Float64[np.ndarray, "p 3"], picture: DepthPicture, independent: float
) -> tuple[Float64[np.ndarray, "4"], Float64[np.ndarray, "4 4"]]:
    """Return the plane of least squares, its normal toward the camera, and its covariance.

    Args:
        points: at least three.
        picture: gives the noise, which is along the rays.
        independent: share of the points whose noise counts as independent; neighbors have the same.
    """
    middle = points.mean(axis=0)
    normal = np.linalg.svd(points - middle, full_matrices=False)[2][2]
    normal = normal if normal @ middle < 0 else -normal
    std = picture.camera.depth_std_m(points[:, 2]) * np.abs((points / points[:, 2:]) @ normal)
    weighted = np.column_stack([points, np.ones(len(points))]) / np.maximum(std, 1e-6)[:, None]
    # The normal keeps its length: it turns about two axes.
    basis = np.zeros((4, 3))
    basis[:3, :2] = np.linalg.svd(normal[None])[2][1:].T
    basis[3, 2] = 1.0
    reduced = weighted @ basis
    covariance: np.ndarray = basis @ np.linalg.pinv(independent * reduced.T @ reduced) @ basis.T
    return np.append(normal, -normal @ middle), covariance


def _area(corners: Float64[np.ndarray, "4 2"]) -> float:
    """Return the area of an outline in square pixels."""
    first, second = corners[2] - corners[0], corners[3] - corners[1]
    return float(abs(first[0] * second[1] - first[1] * second[0])) / 2


def _depth_at(picture: DepthPicture, columns: np.ndarray, rows: np.ndarray) -> Float64[np.ndarray, "..."]:
    """Return the depths of pixels, NaN outside of the picture."""
    height, width = picture.depth_m.shape
    inside = (columns >= 0) & (columns < width) & (rows >= 0) & (rows < height)
    found = picture.depth_m[np.clip(rows, 0, height - 1), np.clip(columns, 0, width - 1)]
    return np.where(inside, found, np.nan).astype(np.float64)


def _point_covariance(space: Float64[np.ndarray, "n 3"], picture: DepthPicture) -> Float64[np.ndarray, "n 3 3"]:
    """Return A diag(s_p², s_p², s_z²) Aᵀ with A the derivative of a point with respect to its pixel and its depth."""
    camera, depth = picture.camera, space[:, 2]
    derivative = np.zeros((len(space), 3, 3))
    derivative[:, 0, 0], derivative[:, 1, 1] = depth / camera.focal_x_px, depth / camera.focal_y_px
    derivative[:, :, 2] = space / depth[:, None]
    variance = np.stack([np.full(len(space), DETECTION_STD_PX**2)] * 2 + [camera.depth_std_m(depth) ** 2], axis=1)
    covariance: np.ndarray = (derivative * variance[:, None]) @ derivative.transpose(0, 2, 1)
    return covariance


def _line_samples(ends: Float64[np.ndarray, "n 2 2"], picture: DepthPicture) -> Float64[np.ndarray, "n s 3"]:
    """Return places along segments in space, with the depth of the nearer side."""
    share = np.linspace(0, 1, SAMPLES)[None, :, None]
    pixels = ends[:, :1] + share * (ends[:, 1:] - ends[:, :1])
    along = ends[:, 1] - ends[:, 0]
    across = np.stack([-along[:, 1], along[:, 0]], axis=1) / np.maximum(np.linalg.norm(along, axis=1), 1e-9)[:, None]
    sides = []
    for side in (-SIDE_PX, SIDE_PX):
        beside = np.round(pixels + side * across[:, None]).astype(np.int64)
        sides.append(_depth_at(picture, beside[..., 0], beside[..., 1]))
    return picture.camera.back_project(pixels, np.fmin(*sides))


def _most_inliers(samples: Float64[np.ndarray, "n s 3"], picture: DepthPicture) -> Bool[np.ndarray, "n s"]:
    """Return which samples agree with the line through the two of them that most agree with."""
    start, end = samples[:, _PAIRS[:, 0]], samples[:, _PAIRS[:, 1]]
    along = end - start
    along = along / np.maximum(np.linalg.norm(along, axis=2, keepdims=True), 1e-12)
    offset = samples[:, None] - start[:, :, None]
    across = offset - (offset * along[:, :, None]).sum(axis=3, keepdims=True) * along[:, :, None]
    near = np.linalg.norm(across, axis=3) <= INLIER_STD * picture.camera.depth_std_m(samples[:, None, :, 2]) + 1e-4
    best = near.sum(axis=2).argmax(axis=1)
    chosen: np.ndarray = near[np.arange(len(samples)), best]
    return chosen


def _fitted_lines(
    samples: Float64[np.ndarray, "n s 3"], inside: Bool[np.ndarray, "n s"], exists: Bool[np.ndarray, " n"]
) -> tuple[Float64[np.ndarray, "n 3"], Float64[np.ndarray, "n 3"]]:
    """Return a point and the direction of the lines of least squared distance to their samples."""
    weight = (inside & exists[:, None])[..., None]
    total = np.maximum(weight.sum(axis=1), 1)
    known = np.where(weight, samples, 0.0)
    middle = known.sum(axis=1) / total
    centered = np.where(weight, samples - middle[:, None], 0.0)
    _, vectors = np.linalg.eigh(centered.transpose(0, 2, 1) @ centered)
    return middle, vectors[:, :, 2]


def _nearest_to_ray(
    middle: Float64[np.ndarray, "n 3"], along: Float64[np.ndarray, "n 3"], ray: Float64[np.ndarray, "n 3"]
) -> Float64[np.ndarray, "n 3"]:
    """Return the points of lines that are nearest to rays from the camera's center."""
    ray = ray / np.linalg.norm(ray, axis=1, keepdims=True)
    cosine = (along * ray).sum(axis=1)
    sine_squared = np.maximum(1 - cosine**2, 1e-9)
    on_line, on_ray = (along * middle).sum(axis=1), (ray * middle).sum(axis=1)
    nearest: np.ndarray = middle + ((cosine * on_ray - on_line) / sine_squared)[:, None] * along
    return nearest


def _line_covariance(
    space: Float64[np.ndarray, "n 2 3"], inliers: np.ndarray, picture: DepthPicture
) -> Float64[np.ndarray, "n 6 6"]:
    """Return the covariance of both ends: of their pixels, and of a line fitted to the depths of N samples.

    The fitted depth at either end of evenly spaced samples has a variance of about 4 s_z² / N, and the depths of the
    two ends a covariance of -2 s_z² / N.
    """
    count = len(space)
    rays = space / space[..., 2:]
    covariance = np.zeros((count, 2, 3, 2, 3))
    for one in range(2):
        pixel = np.zeros((count, 3, 3))
        for axis, focal in enumerate((picture.camera.focal_x_px, picture.camera.focal_y_px)):
            pixel[:, axis, axis] = (DETECTION_STD_PX * space[:, one, 2] / focal) ** 2
        covariance[:, one, :, one] += pixel
        for other in range(2):
            std = picture.camera.depth_std_m(space[:, one, 2]) * picture.camera.depth_std_m(space[:, other, 2])
            factor = (4.0 if one == other else -2.0) * std / inliers
            covariance[:, one, :, other] += factor[:, None, None] * rays[:, one, :, None] * rays[:, other, None, :]
    return covariance.reshape(count, 6, 6)
