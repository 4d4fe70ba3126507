"""Regions of a demonstration's picture that something was taken from, or put down in.

What speaks for a region (each a factor in [0, 1] of its quality):

- it changes at once;
- it is compact;
- its outline is an edge in the picture that shows the thing, and none in the one that does not, in which what lies
  around it goes on: the test for abandoned and removed objects in surveillance;
- little moves around it as long as the thing lies there, while a person who stands there sways;
- something else moves at that time: a thing waits for the hand, while the hand itself is what moves first and last.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import final

import cv2
import numpy as np
from jaxtyping import Bool, Float32, Int32, UInt8
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from geoskill.tracking.pixel_steps import PixelSteps

Mask = UInt8[np.ndarray, "h w"]
Outline = Int32[np.ndarray, "p 1 2"]

# A region has at least this share of the picture, some 9 x 9 pixels of 240 x 320.
MIN_AREA_RATIO = 0.001
# Pixels with a larger share of contradicting pictures do not change in one step.
MAX_INCONSISTENCY = 0.3
# Neighboring pixels belong together when their steps differ by no more than this share of the demonstration.
SAME_STEP_RATIO = 0.03
# Gradient in Lab per pixel below which an edge is noise.
MIN_EDGE = 4.0
# Quality falls by e with each of these: spread of the steps as a share of the demonstration, share of the ring in
# motion. And it is reduced when less than this share of all motion happens while the thing lies there.
SPREAD_SCALE = 0.1
RING_MOTION_SCALE = 0.1
MIN_OTHER_MOTION = 0.05
# The ring around a region, from and to these distances in working pixels.
RING_PX = (2, 8)
# Regions of less quality are not joined.
MIN_JOINED_QUALITY = 0.05


@final
@dataclass(frozen=True, eq=False)
class ChangedRegion:
    """Pixels that change in one step, at the working size of :class:`PixelSteps`.

    Attributes:
        mask: 1 in the region, holes included.
        step: picture in which it changes.
        quality: in [0, 1], how much it looks like a place of a thing.
    """

    mask: Mask
    step: int
    quality: float


def changed_regions(steps: PixelSteps) -> tuple[list[ChangedRegion], list[ChangedRegion]]:
    """Return the regions that something may have been taken from, and those that it may have been put down in."""
    edges = _edge_strength(steps.before), _edge_strength(steps.after)
    motion = steps.moving.mean(axis=(1, 2)).cumsum()
    motion = motion / max(float(motion[-1]), np.finfo(np.float32).tiny)
    old, new = [], []
    for pixels in _components(steps):
        mask = _filled(pixels)
        step = int(np.median(steps.step[pixels]))
        spread = float(np.subtract(*np.percentile(steps.step[pixels], (90, 10)))) / len(steps.frames)
        outline = _outline(mask)
        shape = float(np.exp(-spread / SPREAD_SCALE)) * _compactness(mask, outline)
        taken = min(1.0, float(motion[max(0, step - 1)]) / MIN_OTHER_MOTION)
        put = min(1.0, float(1.0 - motion[step]) / MIN_OTHER_MOTION)
        calm_before, calm_after = _calm(steps, mask, step)
        old.append(ChangedRegion(mask, step, shape * taken * calm_before * _enclosed(outline, edges[0], edges[1])))
        new.append(ChangedRegion(mask, step, shape * put * calm_after * _enclosed(outline, edges[1], edges[0])))
    return old + _joined(old), new


def grown(mask: Mask, pixels: int) -> Mask:
    """Return a mask grown by a number of pixels."""
    return np.asarray(cv2.dilate(mask, np.ones((2 * pixels + 1, 2 * pixels + 1))))


def _components(steps: PixelSteps) -> Iterator[Bool[np.ndarray, "h w"]]:
    """Yield connected regions of pixels that change in one step, neighbors at about the same time."""
    height, width = steps.changed.shape
    usable = steps.changed & (steps.inconsistency < MAX_INCONSISTENCY)
    total = int(usable.sum())
    numbers = np.full((height, width), -1)
    numbers[usable] = np.arange(total)
    same = max(2.0, SAME_STEP_RATIO * len(steps.frames))
    links = []
    for here, there in (
        (np.s_[:, :-1], np.s_[:, 1:]),
        (np.s_[:-1, :], np.s_[1:, :]),
        (np.s_[:-1, :-1], np.s_[1:, 1:]),
        (np.s_[:-1, 1:], np.s_[1:, :-1]),
    ):
        linked = usable[here] & usable[there] & (np.abs(steps.step[here] - steps.step[there]) <= same)
        links.append(np.stack([numbers[here][linked], numbers[there][linked]]))
    rows, columns = np.concatenate(links, axis=1)
    graph = coo_matrix((np.ones(len(rows)), (rows, columns)), shape=(total, total))
    labels = connected_components(graph, directed=False)[1] if total else np.zeros(0, np.int64)
    for label in np.flatnonzero(np.bincount(labels) >= MIN_AREA_RATIO * height * width):
        region = np.zeros((height, width), bool)
        region[usable] = labels == label
        yield region


def _joined(regions: list[ChangedRegion]) -> list[ChangedRegion]:
    """Return the union of each two regions that touch: a hand that grasps a thing hides one part of it before another.

    Its quality is the better one of the two, since the parts together are at least as much of a thing.
    """
    good = [region for region in regions if region.quality > MIN_JOINED_QUALITY]
    return [
        ChangedRegion(first.mask | second.mask, min(first.step, second.step), max(first.quality, second.quality))
        for number, first in enumerate(good)
        for second in good[number + 1 :]
        if (grown(first.mask, 2) & second.mask).any()
    ]


def _outline(mask: Mask) -> Outline:
    outlines, _ = cv2.findContours(mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    return np.asarray(max(outlines, key=cv2.contourArea))


def _filled(pixels: Bool[np.ndarray, "h w"]) -> Mask:
    closed = cv2.morphologyEx(pixels.astype(np.uint8), cv2.MORPH_CLOSE, np.ones((5, 5)))
    return np.asarray(cv2.drawContours(np.zeros_like(closed), [_outline(np.asarray(closed))], -1, 1, -1), np.uint8)


def _compactness(mask: Mask, outline: Outline) -> float:
    """Return the area over that of a circle with the same circumference, at most 1."""
    circumference = max(cv2.arcLength(outline, True), 1.0)
    return min(1.0, 4.0 * np.pi * float(mask.sum()) / circumference**2)


def _edge_strength(picture: Float32[np.ndarray, "h w 3"]) -> Float32[np.ndarray, "h w"]:
    """Return the largest gradient within two pixels: an outline is that exact."""
    horizontal, vertical = (cv2.Scharr(picture, cv2.CV_32F, *axes) / 16.0 for axes in ((1, 0), (0, 1)))
    strength = np.sqrt((horizontal**2 + vertical**2).sum(axis=2))
    return np.asarray(cv2.dilate(strength, np.ones((5, 5))), np.float32)


def _enclosed(outline: Outline, shown: Float32[np.ndarray, "h w"], hidden: Float32[np.ndarray, "h w"]) -> float:
    """Return the share of the outline on an edge in the picture with the thing, and on none in the one without it.

    The picture's border hides what is beyond; it does not count.
    """
    height, width = shown.shape
    x, y = outline[:, 0].T
    inside = (x > 2) & (y > 2) & (x < width - 3) & (y < height - 3)
    if not inside.any():
        return 0.0
    edge, rest = shown[y[inside], x[inside]], hidden[y[inside], x[inside]]
    return float(((edge > MIN_EDGE) & (edge > 2.0 * rest)).mean())


def _calm(steps: PixelSteps, mask: Mask, step: int) -> tuple[float, float]:
    """Return how still the region's surroundings are in a typical picture before the step, and after it."""
    ring = (grown(mask, RING_PX[1]) - grown(mask, RING_PX[0])) > 0
    if not ring.any():
        return 0.0, 0.0
    margin = max(2, round(0.05 * len(steps.frames)))  # the hand comes and goes
    motion = steps.moving[:, ring].mean(axis=1)
    parts = motion[: max(1, step - margin)], motion[min(len(motion) - 1, step + margin) :]
    before, after = (float(np.exp(-np.median(part) / RING_MOTION_SCALE)) for part in parts)
    return before, after
