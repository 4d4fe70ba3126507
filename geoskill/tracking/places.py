"""Where the carried thing of a demonstration was taken from, and where it was put down.

Learning needs to know what comes together. A thing with little texture, or one that moves fast, cannot be followed from
the table into the hand and out of it; but the first and the last pictures show where it was and where it is. Among the
regions that change in one step (:mod:`geoskill.tracking.changed_regions`), this looks for a pair: one that shows
something before and only its surroundings afterwards, one the other way round and later, and both of the same colors.

The thing may be turned and show another side; its place is known all the same, to within its size. There are no such
places where it is in the hand from the first frame on, is held until the last, or is not rigid
(docs/experiments/places.md).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import final

import cv2
import numpy as np
from jaxtyping import Bool, Float32, Float64, UInt8

from geoskill.features.sift import sift_detector
from geoskill.geometry.primitives import centers
from geoskill.tracking.camera_motion import CameraMotion, transformed
from geoskill.tracking.carried_path import CarriedPath, carried_path
from geoskill.tracking.changed_regions import ChangedRegion, changed_regions, grown
from geoskill.tracking.color_bins import color_bins, color_histogram
from geoskill.tracking.pixel_steps import PixelSteps, pixel_steps

Picture = UInt8[np.ndarray, "height width 3"]
Region = Bool[np.ndarray, "height width"]

# Score below which a pair is not believed: of demonstrations that have no such places, the best scored 0.04 at most; of
# those that have them, 0.065 at least (docs/experiments/places.md).
MIN_SCORE = 0.05
# The thing lies at its new place at least this share of the demonstration after it left the old one.
MIN_CARRYING_RATIO = 0.02
# Width of the seam between a thing and its surroundings, as a ratio of the shorter side of the frame. A feature in it
# describes both.
SEAM_RATIO = 0.01
# Radii, over the size of the thing, within which the carried one is seen, and within which it may be.
THING_RADIUS = 0.7
NEAR_RADIUS = 1.0
# Matches that agree on a similarity, at least; their error in pixels, at most; ratio of the best to the second best.
MIN_MATCHES = 4
MATCH_TOLERANCE_PX = 4.0
MATCH_RATIO = 0.8
# Far below the default of SIFT, for a thing may have little texture.
CONTRAST_THRESHOLD = 0.01


@final
@dataclass(frozen=True, eq=False)
class Places:
    """The two places of the carried thing, in pixels of the first frame.

    Attributes:
        old, new: masks of the thing at either place.
        picked: first frame in which something covers or moves the thing at its old place.
        placed: first frame from which on the thing lies at its new place.
        to_new: ``[2, 3]``, the similarity that takes the thing from its old place to its new one.
        score: in [0, 1], how well this pair fits.
        path: where the thing is in between.
        steps: of the pixels, from which the places were found.
    """

    old: Region
    new: Region
    picked: int
    placed: int
    to_new: Float64[np.ndarray, "2 3"]
    score: float
    path: CarriedPath
    steps: PixelSteps

    @property
    def camera(self) -> CameraMotion:
        """How the camera moved."""
        return self.steps.camera

    def carried(self, frame: int) -> bool:
        """Tell whether the thing is at neither place in a frame, or may be."""
        return self.picked <= frame < self.placed

    def resting(self, frame: int) -> tuple[Region | None, Region]:
        """Return where the thing is seen at rest in a frame, or None, and where the background is, in first pixels.

        The background is what looks as in the first or the last pictures, and did not change between them, or is not
        yet, or no longer, covered by the thing.
        """
        nearest = self.steps.nearest(frame)
        before, after = (
            _enlarged(mask, self.old.shape)
            for mask in (self.steps.like_before[nearest], self.steps.like_after[nearest])
        )
        background = (before | after) & self._free & ~self.seam(frame)
        if self.carried(frame):
            return None, background
        return (self.old & before if frame < self.picked else self.new & after), background

    def carried_region(self, frame: int) -> tuple[Region, Region] | None:
        """Return where the carried thing is seen in a frame, and where it may be; None where that is not known."""
        number = self.path.number(frame) if self.carried(frame) else None
        if number is None:
            return None
        height, width = self.old.shape
        y, x = np.ogrid[:height, :width]
        distance = np.hypot(x - self.path.centers[number, 0], y - self.path.centers[number, 1])
        like = _enlarged(self.path.thing_like[number], self.old.shape)
        return (distance < THING_RADIUS * self.path.size_px) & like, distance < NEAR_RADIUS * self.path.size_px

    def center(self, frame: int) -> Float64[np.ndarray, "2"] | None:
        """Return the thing's center in a frame, in first pixels, or None where it is not known."""
        if not self.carried(frame):
            return self._centers[0] if frame < self.picked else self._centers[1]
        number = self.path.number(frame)
        return None if number is None else self.path.centers[number]

    def seam(self, frame: int) -> Region:
        """Return the place at which the thing rests in a frame, with what cannot be told apart from it there."""
        if self.carried(frame):
            return np.zeros_like(self.old)
        return self._wide_old if frame < self.picked else self._wide_new

    def moved(self, frame: int, other: int, geometry: Float32[np.ndarray, "n g"]) -> Float32[np.ndarray, "n g"] | None:
        """Return where points or segments of the thing at rest in one frame are in another, or None, in first pixels.

        None when it is not known where it is. While it is carried, its turn is taken to be that of the frame.
        """
        if self.carried(frame) or self.carried(other):
            here, there = self.center(frame), self.center(other)
            if here is None or there is None:
                return None
            return np.asarray(geometry + np.tile(there - here, geometry.shape[1] // 2), np.float32)
        was_old, is_old = frame < self.picked, other < self.picked
        if was_old == is_old:
            return geometry
        transform = self.to_new if was_old else cv2.invertAffineTransform(self.to_new)
        return transformed(transform, geometry)

    @cached_property
    def around_new(self) -> Region:
        """Where the target is seen: the new place, and around it as far as the thing is large."""
        size_px = max(1, round(float(np.sqrt(self.new.sum()))))
        return np.asarray(grown(self.new.astype(np.uint8), size_px) > 0)

    @cached_property
    def _centers(self) -> tuple[Float64[np.ndarray, "2"], Float64[np.ndarray, "2"]]:
        old, new = (np.argwhere(mask).mean(axis=0)[::-1] for mask in (self.old, self.new))
        return old, new

    @cached_property
    def _wide_old(self) -> Region:
        return _widened(self.old)

    @cached_property
    def _wide_new(self) -> Region:
        return _widened(self.new)

    @cached_property
    def _free(self) -> Region:
        """Where nothing but the thing itself changes between the first and the last pictures."""
        changed = _widened(_enlarged(self.steps.changed, self.old.shape))
        return np.asarray(~changed | self._wide_old | self._wide_new)


def find_places(frames: Sequence[Picture]) -> Places | None:
    """Find the places of the carried thing, or None when no pair of regions looks like them.

    Args:
        frames: RGB pictures of the demonstration.
    """
    steps = pixel_steps(frames)
    old_regions, new_regions = changed_regions(steps)
    scored = [
        (_pair_score(steps, old, new), old, new)
        for old in old_regions
        for new in new_regions
        if old.quality * new.quality >= MIN_SCORE  # colors are compared for few pairs
    ]
    score, old, new = max(scored, key=lambda pair: pair[0], default=(0.0, None, None))
    if old is None or new is None or score < MIN_SCORE:
        return None
    old_mask, new_mask = (_enlarged(region.mask > 0, frames[0].shape[:2]) for region in (old, new))
    picked, placed = max(0, old.step - 1), new.step
    scale = old.mask.shape[0] / frames[0].shape[0]
    return Places(
        old_mask,
        new_mask,
        picked=int(steps.frames[picked]),
        placed=int(steps.frames[placed]),
        to_new=_alignment(frames[0], old_mask, _steadied(frames[-1], steps.camera), new_mask),
        score=score,
        path=carried_path(steps, old.mask > 0, new.mask > 0, picked, placed, scale),
        steps=steps,
    )


def is_in(region: Region, geometry: Float32[np.ndarray, "n g"]) -> Bool[np.ndarray, " n"]:
    """Return which points, or midpoints of segments, are in a region; none beyond the border of the picture."""
    height, width = region.shape
    x, y = centers(geometry).round().astype(np.int64).T
    inside = (x >= 0) & (y >= 0) & (x < width) & (y < height)
    return np.asarray(inside & region[y.clip(0, height - 1), x.clip(0, width - 1)])


def _steadied(last: Picture, camera: CameraMotion) -> Picture:
    """Return the last frame laid over the first one."""
    if camera.at_rest:
        return last
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    return np.asarray(cv2.warpAffine(last, camera.transforms[-1], last.shape[1::-1], flags=flags), np.uint8)


def _enlarged(mask: Bool[np.ndarray, "h w"], shape: tuple[int, ...]) -> Region:
    """Return a mask of the working size at the size of a frame."""
    height, width = shape
    return np.asarray(cv2.resize(mask.astype(np.uint8), (width, height), interpolation=cv2.INTER_NEAREST) > 0)


def _widened(mask: Region) -> Region:
    """Return a mask grown by the width of the seam."""
    seam_px = max(1, round(SEAM_RATIO * min(mask.shape)))
    return np.asarray(grown(mask.astype(np.uint8), seam_px) > 0)


def _pair_score(steps: PixelSteps, old: ChangedRegion, new: ChangedRegion) -> float:
    """Return in [0, 1] how well two regions fit as the places of one thing: both good, alike, and of similar size."""
    if new.step <= old.step + MIN_CARRYING_RATIO * len(steps.frames):
        return 0.0
    areas = float(old.mask.sum()), float(new.mask.sum())
    old_colors, new_colors = (
        color_histogram(color_bins(picture[mask > 0]))
        for picture, mask in ((steps.before, old.mask), (steps.after, new.mask))
    )
    alike = float(np.sqrt(old_colors * new_colors).sum())
    return old.quality * new.quality * alike * min(1.0, 2.0 * min(areas) / max(areas))


def _alignment(first: Picture, old: Region, last: Picture, new: Region) -> Float64[np.ndarray, "2 3"]:
    """Return the similarity between the places on which keypoints agree, or else the shift of their centers."""
    center, other_center = (np.argwhere(mask).mean(axis=0)[::-1] for mask in (old, new))
    shift = np.hstack([np.eye(2), (other_center - center)[:, None]])
    here, there = _matches(first, old, last, new)
    if len(here) < MIN_MATCHES:
        return shift
    similarity, agree = cv2.estimateAffinePartial2D(
        here, there, method=cv2.RANSAC, ransacReprojThreshold=MATCH_TOLERANCE_PX
    )
    if similarity is None or agree.sum() < MIN_MATCHES:
        return shift
    scale = float(np.hypot(similarity[0, 0], similarity[1, 0]))
    off_px = float(np.linalg.norm(similarity[:, :2] @ center + similarity[:, 2] - other_center))
    return np.asarray(similarity if 0.5 < scale < 2.0 and off_px < np.sqrt(new.sum()) / 2.0 else shift, np.float64)


def _matches(
    first: Picture, old: Region, last: Picture, new: Region
) -> tuple[Float32[np.ndarray, "k 2"], Float32[np.ndarray, "k 2"]]:
    """Return matching SIFT keypoints of the thing at either place."""
    detector = sift_detector(CONTRAST_THRESHOLD)
    points, descriptors = [], []
    for picture, mask in ((first, old), (last, new)):
        gray = cv2.cvtColor(picture, cv2.COLOR_RGB2GRAY)
        keypoints, described = detector.detectAndCompute(gray, mask.astype(np.uint8) * 255)
        points.append(np.array([keypoint.pt for keypoint in keypoints], np.float32).reshape(-1, 2))
        descriptors.append(described)
    if any(described is None for described in descriptors):
        return points[0][:0], points[1][:0]
    pairs = [pair for pair in cv2.BFMatcher().knnMatch(descriptors[0], descriptors[1], k=2) if len(pair) == 2]
    good = [best for best, second in pairs if best.distance < MATCH_RATIO * second.distance]
    return points[0][[match.queryIdx for match in good]], points[1][[match.trainIdx for match in good]]
