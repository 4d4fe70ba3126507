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
from scipy.ndimage import gaussian_filter

from geoskill.features.sift import sift_detector
from geoskill.geometry.primitives import centers
from geoskill.tracking.changed_regions import ChangedRegion, changed_regions, grown
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
# Matches that agree on a similarity, at least; their error in pixels, at most; ratio of the best to the second best.
MIN_MATCHES = 4
MATCH_TOLERANCE_PX = 4.0
MATCH_RATIO = 0.8
# Far below the default of SIFT, for a thing may have little texture.
CONTRAST_THRESHOLD = 0.01


@final
@dataclass(frozen=True, eq=False)
class Places:
    """The two places of the carried thing, in pixels of the frames.

    Attributes:
        old, new: masks of the thing at either place.
        picked: first frame in which something covers or moves the thing at its old place.
        placed: first frame from which on the thing lies at its new place.
        to_new: ``[2, 3]``, the similarity that takes the thing from its old place to its new one.
        score: in [0, 1], how well this pair fits.
        steps: of the pixels, from which the places were found.
    """

    old: Region
    new: Region
    picked: int
    placed: int
    to_new: Float64[np.ndarray, "2 3"]
    score: float
    steps: PixelSteps

    def carried(self, frame: int) -> bool:
        """Tell whether the thing is at neither place in a frame, or may be."""
        return self.picked <= frame < self.placed

    def resting(self, frame: int) -> tuple[Region | None, Region]:
        """Return where the thing is seen at rest in a frame, or None, and where the background is.

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

    def seam(self, frame: int) -> Region:
        """Return the place at which the thing rests in a frame, with what cannot be told apart from it there."""
        if self.carried(frame):
            return np.zeros_like(self.old)
        return self._wide_old if frame < self.picked else self._wide_new

    def moved(self, frame: int, other: int, geometry: Float32[np.ndarray, "n g"]) -> Float32[np.ndarray, "n g"] | None:
        """Return where points or segments of the thing at rest in one frame are in another, or None.

        None when it does not rest at one of its places in both.
        """
        if self.carried(frame) or self.carried(other):
            return None
        was_old, is_old = frame < self.picked, other < self.picked
        if was_old == is_old:
            return geometry
        transform = self.to_new if was_old else cv2.invertAffineTransform(self.to_new)
        points = geometry.reshape(len(geometry), geometry.shape[1] // 2, 2)
        return np.asarray((points @ transform[:, :2].T + transform[:, 2]).reshape(geometry.shape), np.float32)

    @cached_property
    def around_new(self) -> Region:
        """Where the target is seen: the new place, and around it as far as the thing is large."""
        size_px = max(1, round(float(np.sqrt(self.new.sum()))))
        return np.asarray(grown(self.new.astype(np.uint8), size_px) > 0)

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
    return Places(
        old_mask,
        new_mask,
        picked=int(steps.frames[max(0, old.step - 1)]),
        placed=int(steps.frames[new.step]),
        to_new=_alignment(frames[0], old_mask, frames[-1], new_mask),
        score=score,
        steps=steps,
    )


def is_in(region: Region, geometry: Float32[np.ndarray, "n g"]) -> Bool[np.ndarray, " n"]:
    """Return which points, or midpoints of segments, are in a region; none beyond the border of the picture."""
    height, width = region.shape
    x, y = centers(geometry).round().astype(np.int64).T
    inside = (x >= 0) & (y >= 0) & (x < width) & (y < height)
    return np.asarray(inside & region[y.clip(0, height - 1), x.clip(0, width - 1)])


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
    alike = float(np.sqrt(_colors(steps.before, old.mask) * _colors(steps.after, new.mask)).sum())
    return old.quality * new.quality * alike * min(1.0, 2.0 * min(areas) / max(areas))


def _colors(picture: Float32[np.ndarray, "h w 3"], mask: UInt8[np.ndarray, "h w"]) -> Float64[np.ndarray, "l a b"]:
    """Return the smoothed histogram of the colors in a region, in bins of about 8 units of Lab; its sum is 1."""
    histogram, _ = np.histogramdd(picture[mask > 0], bins=(12, 32, 32), range=((0, 100), (-128, 128), (-128, 128)))
    smooth = gaussian_filter(histogram, 0.8)
    return np.asarray(smooth / smooth.sum())


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
