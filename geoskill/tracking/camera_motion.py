"""How the camera moved in a demonstration, so that its pictures can be compared pixel by pixel.

A camera in a hand, or on a table that is pushed, moves by a pixel or by many. The edges of the first picture, evenly
spread, are laid over every other one by Gauss and Newton's method ("An iterative image registration technique", Lucas
and Kanade, IJCAI 1981), with Tukey's weights, so that what moves in front of the camera is outvoted as long as it has
fewer edges than what rests. Edges serve where corners do not: behind a person in a patterned shirt there may be a plain
wall. The camera is taken to be at rest unless clearly more edges fit when it moved. A camera that travels, so that
parallax shows, is not covered by a similarity.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import final

import cv2
import numpy as np
from jaxtyping import Float32, Float64, Int64, UInt8

from geoskill.geometry.robust import MAD_TO_STD, biweight
from geoskill.geometry.sampling import resized, sample_bilinear

# Edges: the pixels of most contrast in every cell of the working picture.
CELL_PX = 16
PIXELS_PER_CELL = 12
MIN_CONTRAST = 4.0
BLUR_PX = 1.0
# Reductions of the picture, coarse to fine, and steps at each.
LEVELS = (4, 2, 1)
MAX_STEPS = 8
SMALLEST_STEP = 0.02
# Tukey's weight is zero from so many standard deviations on, which are at least so many gray values.
CUTOFF = 4.0
MIN_SCALE = 2.0
# An edge fits when its gray value differs by less.
FITTING = 6.0
# The camera is taken to be at rest unless so many times more edges fit when it moved, and a motion is not believed
# when fewer than this share fits.
MOVED_GAIN = 1.25
MIN_FITTING = 0.25
# Pictures with fewer edges say nothing.
MIN_EDGES = 100
# A first step below this many working pixels is noise.
MOVED_PX = 0.1
IDENTITY = np.eye(2, 3)
REST = np.zeros(4)


@final
@dataclass(frozen=True, eq=False)
class CameraMotion:
    """Where the pixels of the first picture are in the others.

    Attributes:
        frames: ``[s]``, the frames that were compared; between two of them the motion is interpolated.
        transforms: ``[s, 2, 3]``, similarities that take pixels of the first frame to those of each.
    """

    frames: Int64[np.ndarray, " s"]
    transforms: Float64[np.ndarray, "s 2 3"]

    @cached_property
    def at_rest(self) -> bool:
        """Whether the camera did not move at all."""
        return bool((self.transforms == IDENTITY).all())

    def transform(self, frame: int) -> Float64[np.ndarray, "2 3"]:
        """Return the similarity that takes pixels of the first frame to those of another."""
        after = int(np.searchsorted(self.frames, frame).clip(1, len(self.frames) - 1)) if len(self.frames) > 1 else 0
        before = max(0, after - 1)
        span = float(self.frames[after] - self.frames[before])
        weight = (frame - float(self.frames[before])) / span if span else 0.0
        return np.asarray((1.0 - weight) * self.transforms[before] + weight * self.transforms[after])

    def to_first(self, frame: int, geometry: Float32[np.ndarray, "n g"]) -> Float32[np.ndarray, "n g"]:
        """Return points or segments of a frame in pixels of the first one."""
        return geometry if self.at_rest else transformed(cv2.invertAffineTransform(self.transform(frame)), geometry)

    def from_first(self, frame: int, geometry: Float32[np.ndarray, "n g"]) -> Float32[np.ndarray, "n g"]:
        """Return points or segments of the first frame in pixels of another."""
        return geometry if self.at_rest else transformed(self.transform(frame), geometry)


def transformed(
    transform: Float64[np.ndarray, "2 3"], geometry: Float32[np.ndarray, "n g"]
) -> Float32[np.ndarray, "n g"]:
    """Return transformed points ``[n, 2]`` or segments ``[n, 4]``."""
    points = geometry.reshape(len(geometry), geometry.shape[1] // 2, 2)
    return np.asarray((points @ transform[:, :2].T + transform[:, 2]).reshape(geometry.shape), np.float32)


def resized_transform(transform: Float64[np.ndarray, "2 3"], factor: float) -> Float64[np.ndarray, "2 3"]:
    """Return a transform between two pictures for their versions of another size; pixel edges stay in place."""
    half = np.array([0.5, 0.5])
    return np.column_stack(
        [
            transform[:, :2],
            factor * (transform[:, :2] @ -half + transform[:, 2] + half) + transform[:, :2] @ half - half,
        ]
    )


def camera_transforms(pictures: Sequence[UInt8[np.ndarray, "h w"]]) -> Float64[np.ndarray, "s 2 3"]:
    """Return the similarities that take the first of some gray pictures to each of them.

    Exactly the identity for a picture in which the camera is where it was, and where nothing can be said at all.
    """
    transforms = np.tile(IDENTITY, (len(pictures), 1, 1))
    edges = [_edges(_reduced(pictures[0], factor), factor, pictures[0].shape) for factor in LEVELS]
    if len(edges[-1].values) < MIN_EDGES:
        return transforms
    motion = REST
    for number, picture in enumerate(pictures[1:], start=1):
        motion = _next_motion(edges, picture, motion)
        transforms[number] = _similarity(motion, picture.shape)
    return transforms


def _next_motion(
    edges: Sequence["_Edges"], picture: UInt8[np.ndarray, "h w"], last: Float64[np.ndarray, "4"]
) -> Float64[np.ndarray, "4"]:
    """Return the motion from the first picture to this one; the last one where nothing can be said."""
    reduced = [_reduced(picture, factor) for factor in LEVELS]
    at_rest = _fitting(edges[-1], reduced[-1], REST)
    if at_rest >= MIN_FITTING and np.abs(_step(edges[-1], reduced[-1], REST)).max() < MOVED_PX:
        return REST
    found, fitting = _aligned(edges, reduced, last)
    if fitting < MIN_FITTING and last.any():
        found, fitting = _aligned(edges, reduced, REST)
    if fitting < MIN_FITTING:
        return last
    return found if fitting > MOVED_GAIN * at_rest else REST


@final
@dataclass(frozen=True, eq=False)
class _Edges:
    """Edge pixels of the first picture at one reduction.

    Attributes:
        factor: of the reduction.
        offset: ``[e, 2]``, from the center of the picture, over half its longer side.
        place: ``[e, 2]``, in working pixels.
        values: ``[e]``, gray values.
        slope: ``[e, 4]``, by how much the gray value there changes with shift (x, y), size and turn.
    """

    factor: int
    offset: Float64[np.ndarray, "e 2"]
    place: Float64[np.ndarray, "e 2"]
    values: Float32[np.ndarray, " e"]
    slope: Float64[np.ndarray, "e 4"]


def _reduced(picture: UInt8[np.ndarray, "h w"], factor: int) -> Float32[np.ndarray, "r c"]:
    small = resized(picture, 1.0 / factor).astype(np.float32)
    return np.asarray(cv2.GaussianBlur(small, (0, 0), BLUR_PX), np.float32)


def _center(shape: tuple[int, ...]) -> tuple[Float64[np.ndarray, "2"], float]:
    """Return the center of a picture, and half its longer side."""
    return np.array([shape[1], shape[0]]) / 2.0 - 0.5, max(shape) / 2.0


def _edges(picture: Float32[np.ndarray, "r c"], factor: int, shape: tuple[int, ...]) -> _Edges:
    """Return the pixels of most contrast in every cell of a reduced picture."""
    horizontal, vertical = (cv2.Scharr(picture, cv2.CV_32F, *axes) / 32.0 for axes in ((1, 0), (0, 1)))
    contrast = np.hypot(horizontal, vertical)
    contrast[[0, -1]], contrast[:, [0, -1]] = 0.0, 0.0
    cell = max(6, CELL_PX // factor)
    rows, columns = np.nonzero(contrast > MIN_CONTRAST)
    cells = (rows // cell) * picture.shape[1] + columns // cell
    order = np.lexsort((-contrast[rows, columns], cells))
    first = np.searchsorted(cells[order], cells[order])  # where its cell begins
    kept = order[np.arange(len(order)) - first < PIXELS_PER_CELL]
    rows, columns = rows[kept], columns[kept]
    center, half = _center(shape)
    place = (np.stack([columns, rows], axis=1) + 0.5) * factor - 0.5
    offset = (place - center) / half
    slope = np.stack([horizontal[rows, columns], vertical[rows, columns]], axis=1).astype(np.float64) / factor
    size = (slope * offset).sum(axis=1)
    turn = slope[:, 1] * offset[:, 0] - slope[:, 0] * offset[:, 1]
    return _Edges(factor, offset, place, picture[rows, columns], np.column_stack([slope, size, turn]))


def _aligned(
    edges: Sequence[_Edges], pictures: Sequence[Float32[np.ndarray, "_ _"]], start: Float64[np.ndarray, "4"]
) -> tuple[Float64[np.ndarray, "4"], float]:
    """Return the motion under which the edges fit a picture best, and the share of them that fit.

    Args:
        edges: of the first picture, at every reduction.
        pictures: the other picture at every reduction.
        start: shift in working pixels, and size and turn as what they shift half the longer side by.
    """
    motion = start.copy()
    for own, picture in zip(edges, pictures, strict=True):
        if len(own.values) < MIN_EDGES:
            continue
        for _ in range(MAX_STEPS):
            step = _step(own, picture, motion)
            motion += step
            if np.abs(step).max() < SMALLEST_STEP:
                break
    return motion, _fitting(edges[-1], pictures[-1], motion)


def _step(
    edges: _Edges, picture: Float32[np.ndarray, "r c"], motion: Float64[np.ndarray, "4"]
) -> Float64[np.ndarray, "4"]:
    """Return the step of Gauss and Newton, weighted by Tukey, from a motion to a better one."""
    residual, inside = _residual(edges, picture, motion)
    scale = max(MIN_SCALE, MAD_TO_STD * float(np.median(np.abs(residual))))
    weight = inside * biweight(residual, scale, CUTOFF)
    normal = edges.slope.T @ (edges.slope * weight[:, None])
    normal += (1e-3 * np.trace(normal) / 4.0 + 1e-9) * np.eye(4)  # directions that no edge tells of
    return np.asarray(-np.linalg.solve(normal, edges.slope.T @ (weight * residual)))


def _residual(
    edges: _Edges, picture: Float32[np.ndarray, "r c"], motion: Float64[np.ndarray, "4"]
) -> tuple[Float64[np.ndarray, " e"], Float64[np.ndarray, " e"]]:
    """Return the differences of gray values but for their median, which is the light's, and 1 inside the picture."""
    x, y = edges.offset.T
    shift = motion[:2] + np.stack([motion[2] * x - motion[3] * y, motion[3] * x + motion[2] * y], axis=1)
    there = ((edges.place + shift + 0.5) / edges.factor - 0.5).astype(np.float32)
    height, width = picture.shape
    inside = ((there >= 0) & (there <= (width - 1, height - 1))).all(axis=1)
    residual = sample_bilinear(picture, there).astype(np.float64) - edges.values
    residual -= np.median(residual[inside]) if inside.any() else 0.0
    return residual, inside.astype(np.float64)


def _fitting(edges: _Edges, picture: Float32[np.ndarray, "r c"], motion: Float64[np.ndarray, "4"]) -> float:
    residual, inside = _residual(edges, picture, motion)
    return float(((np.abs(residual) < FITTING) * inside).mean())


def _similarity(motion: Float64[np.ndarray, "4"], shape: tuple[int, ...]) -> Float64[np.ndarray, "2 3"]:
    """Return the motion as a matrix for working pixels; exactly the identity for none."""
    center, half = _center(shape)
    size, turn = motion[2] / half, motion[3] / half
    linear = np.array([[1.0 + size, -turn], [turn, 1.0 + size]])
    return np.column_stack([linear, motion[:2] + center - linear @ center])
