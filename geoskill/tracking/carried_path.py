"""Where the thing of a demonstration is while it is carried.

Both of its places are known, and its colors. What has its colors rather than those of the person, and differs from what
the place shows otherwise, may be the thing; the path from the old place to the new one that meets most of that, and
does not jump, is found by dynamic programming (Viterbi 1967). No picture has to follow from the one before it, so the
thing may move fast, turn, and be hidden in part by the hand.
"""

from dataclasses import dataclass
from typing import final

import cv2
import numpy as np
from jaxtyping import Bool, Float32, Float64, Int64
from scipy.ndimage import binary_dilation, gaussian_filter

from geoskill.tracking.color_bins import color_histogram
from geoskill.tracking.pixel_steps import PixelSteps

# Evidence of a pixel: the log ratio of its color's share among the thing's and the person's pixels, at most this. The
# hand covers a part of the thing, so what is against it counts little for the path.
AGAINST, FOR = -0.5, 2.0
# The thing at rest at one of its places.
RESTING = 1.0
# Share of a color that is as good as none.
NO_SHARE = 1e-5
# A color is among the thing's when its share is at least this much of the most frequent one's.
COMMON_RATIO = 0.05
# The path's steps in working pixels; and the distance, over the shorter side, that costs as much as a whole thing in
# sight brings: 1.
STRIDE_PX = 6
FAR_RATIO = 0.19
# The evidence around a thing, out to this many times its size, is subtracted: a thing ends where it ends.
SURROUNDINGS = 1.7
# Where the evidence on the path is less, the thing is not seen, or it is somewhere else.
MIN_EVIDENCE = 0.1
# What looks like the thing has at least so much evidence, averaged over this standard deviation in working pixels: its
# outline before the background has, that beside the fingers has not.
MIN_LIKE = 0.5
BLUR_PX = 1.5


@final
@dataclass(frozen=True, eq=False)
class CarriedPath:
    """The place of the thing in those of the compared frames in which it is carried, in pixels of the first frame.

    Attributes:
        frames: ``[k]``, ascending.
        centers: ``[k, 2]``.
        seen: ``[k]``, whether the thing is seen there.
        thing_like: ``[k]`` masks at the working size: what looks like the thing.
        size_px: square root of the thing's area.
    """

    frames: Int64[np.ndarray, " k"]
    centers: Float64[np.ndarray, "k 2"]
    seen: Bool[np.ndarray, " k"]
    thing_like: Bool[np.ndarray, "k h w"]
    size_px: float

    def number(self, frame: int) -> int | None:
        """Return which of the frames it is, or None where it is none of them, or the thing is not seen in it."""
        found = int(np.searchsorted(self.frames, frame))
        return found if found < len(self.frames) and self.frames[found] == frame and self.seen[found] else None


def carried_path(
    steps: PixelSteps,
    old: Bool[np.ndarray, "h w"],
    new: Bool[np.ndarray, "h w"],
    picked: int,
    placed: int,
    scale: float,
) -> CarriedPath:
    """Follow the thing from its old place to its new one.

    Args:
        steps: what is known of the demonstration's pixels.
        old: the thing's first place, at the working size.
        new: its last place.
        picked: the first of the compared pictures in which the thing may be gone from its old place.
        placed: the first of them, after that, in which it lies at its new place.
        scale: working size over that of the frames.
    """
    size = float(np.sqrt((old.sum() + new.sum()) / 2.0))
    thing, other = _colors(steps, old, new, picked, placed)
    ratio = np.log((thing + NO_SHARE) / (other + NO_SHARE)).clip(-FOR, FOR)
    common = thing > COMMON_RATIO * thing.max()
    sums, thing_like = [], []
    for number in range(picked, placed + 1):
        colors = steps.colors[number]
        # What is always there says nothing where it has the thing's colors: the thing may be in front of it.
        evidence = np.where(steps.usual[number], np.where(common[colors], 0.0, AGAINST), ratio[colors])
        evidence[(old & steps.like_before[number]) | (new & steps.like_after[number])] = RESTING
        sums.append(_enclosed(np.maximum(evidence, AGAINST).astype(np.float32), size))
        thing_like.append(gaussian_filter(evidence, BLUR_PX) > MIN_LIKE)
    grid = np.stack([own[::STRIDE_PX, ::STRIDE_PX] for own in sums])
    ends = tuple(np.argwhere(mask).mean(axis=0) / STRIDE_PX for mask in (old, new))
    far = FAR_RATIO * min(old.shape) / STRIDE_PX
    places = best_path(grid, ends[0], ends[1], far)
    return CarriedPath(
        steps.frames[picked : placed + 1],
        (places[:, ::-1] * STRIDE_PX + 0.5) / scale - 0.5,
        grid[np.arange(len(grid)), places[:, 0], places[:, 1]] > MIN_EVIDENCE,
        np.stack(thing_like),
        size / scale,
    )


def best_path(
    values: Float32[np.ndarray, "k rows columns"],
    start: Float64[np.ndarray, "2"],
    end: Float64[np.ndarray, "2"],
    far: float,
) -> Int64[np.ndarray, "k 2"]:
    """Return the cells (row, column), one per grid, with the largest sum of values less the squared steps over far².

    Args:
        values: at least one grid.
        start: where the first cell has to be; the nearest one is taken.
        end: where the last cell has to be.
        far: length of a step that costs 1.

    >>> best_path(np.zeros((3, 1, 9), np.float32), np.array([0.0, 0.0]), np.array([0.0, 8.0]), 1.0).tolist()
    [[0, 0], [0, 4], [0, 8]]
    """
    shape = values.shape[1:]
    first, last = (tuple(np.clip(np.rint(cell), 0, np.array(shape) - 1).astype(int)) for cell in (start, end))
    best = np.full(shape, -np.inf)
    best[first] = values[0][first]
    sources = []
    for grid in values[1:]:
        best, source = _spread(best, far)
        best = best + grid
        sources.append(source)
    path = [last]
    for source in reversed(sources):
        path.append(tuple(int(index[path[-1]]) for index in source))
    return np.array(path[::-1], np.int64)


def _spread(
    best: Float64[np.ndarray, "rows columns"], far: float
) -> tuple[
    Float64[np.ndarray, "rows columns"], tuple[Int64[np.ndarray, "rows columns"], Int64[np.ndarray, "rows columns"]]
]:
    """Return for each cell the best value to come from, less the squared step over far², and the cell it is of."""
    row_cost, column_cost = ((np.subtract.outer(np.arange(count), np.arange(count)) / far) ** 2 for count in best.shape)
    along = best[:, :, None] - column_cost  # from column (axis 1) to column (axis 2)
    from_column, along_best = along.argmax(axis=1), along.max(axis=1)
    across = along_best[:, None, :] - row_cost[:, :, None]  # from row (axis 0) to row (axis 1)
    from_row = across.argmax(axis=0)
    return across.max(axis=0), (from_row, np.take_along_axis(from_column, from_row, axis=0))


def _colors(
    steps: PixelSteps, old: Bool[np.ndarray, "h w"], new: Bool[np.ndarray, "h w"], picked: int, placed: int
) -> tuple[Float64[np.ndarray, " b"], Float64[np.ndarray, " b"]]:
    """Return the color histograms of the thing, and of what else is seen while it rests: the person and the scene."""
    thing = [
        color_histogram(steps.colors[number][_inner(mask)]) for number, mask in ((0, old), (len(steps.colors) - 1, new))
    ]
    elsewhere = ~binary_dilation(old | new, iterations=4)
    resting = np.r_[0 : max(1, picked - 1), placed + 1 : len(steps.colors)]
    person = steps.colors[resting][~steps.usual[resting] & elsewhere]
    scene = steps.colors[[0, -1]][:, elsewhere].ravel()
    # As much of the person as of the scene, which is always there, whichever has more pixels.
    return np.mean(thing, axis=0), (color_histogram(person) + color_histogram(scene)) / 2.0


def _inner(mask: Bool[np.ndarray, "h w"]) -> Bool[np.ndarray, "h w"]:
    """Return a mask without its border, whose colors are mixed; the mask itself where nothing else is left."""
    inner = cv2.erode(mask.astype(np.uint8), np.ones((3, 3))) > 0
    return np.asarray(inner if inner.any() else mask)


def _enclosed(evidence: Float32[np.ndarray, "h w"], size: float) -> Float32[np.ndarray, "h w"]:
    """Return the mean evidence in a square of a size around each pixel, less what there is around the square."""
    side, wide = (2 * max(1, round(ratio * size / 2.0)) + 1 for ratio in (1.0, SURROUNDINGS))
    inner, outer = (
        cv2.boxFilter(evidence, -1, (length, length), borderType=cv2.BORDER_CONSTANT) for length in (side, wide)
    )
    ring = (outer * wide**2 - inner * side**2) / (wide**2 - side**2)
    return np.asarray(inner - np.maximum(0.0, ring), np.float32)
