"""Pixels of a demonstration that change once and for all, where a thing was taken away or put down.

A pixel of the place that a thing is taken from shows the thing and then, after a hand has passed, what was behind it.
One of the place where it is put down shows the reverse. Both change in one step, while a pixel that a person passes or
leaves changes many times, or gradually. Only the ends of the demonstration and the time of the step matter, so nothing
has to be tracked while the thing moves fast, turns, or is hidden by the hand.

Where the camera moved, the pictures are first laid over the first one (:mod:`geoskill.tracking.camera_motion`).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import final

import cv2
import numpy as np
from jaxtyping import Bool, Float32, Int64, UInt8, UInt16

from geoskill.geometry.sampling import resized
from geoskill.tracking.camera_motion import IDENTITY, CameraMotion, camera_transforms, resized_transform
from geoskill.tracking.color_bins import color_bins

# Pictures are compared at this shorter side, and no more than so many of them, evenly spaced.
WORKING_SIDE = 240
MAX_PICTURES = 240
# Pictures at either end whose median shows how things are before and after: this share of all, and no more than so
# many. In a video of few pictures a second, the hand is still at the thing in the last but one.
END_RATIO = 0.02
MAX_END_PICTURES = 3
# Pictures whose median is a typical one, about.
TYPICAL_PICTURES = 40
# Smallest differences in Lab that count, a few times what noise and compression leave after the blur: between the ends,
# and from one picture to the next.
MIN_CHANGE = 12.0
MIN_MOTION = 4.0
BLUR_PX = 1.0
# Darker and brighter pixels, of 1, tell little of the exposure.
MIN_LIT, MAX_LIT = 0.1, 0.95


@final
@dataclass(frozen=True, eq=False)
class PixelSteps:
    """The changes of a demonstration's pixels, at the working size.

    Attributes:
        frames: ``[s]``, the frames that were compared.
        before, after: Lab, medians of the first and of the last pictures.
        changed: whether a pixel differs between the two.
        step: index into ``frames`` of the first picture that rather looks like ``after``; 0 where nothing changed.
        inconsistency: share of the pictures that look neither like ``before`` until the step nor like ``after`` from
            it on; 1 where nothing changed.
        moving: whether a pixel differs from the picture before it; False in the first.
        like_before, like_after: whether a pixel and its neighbors look as in the first, or in the last pictures.
        usual: whether a pixel looks as in the first, the last, or a typical picture.
        colors: of the pixels, in bins (:mod:`geoskill.tracking.color_bins`).
        camera: how it moved; all pixels are those of the first picture.
    """

    frames: Int64[np.ndarray, " s"]
    before: Float32[np.ndarray, "h w 3"]
    after: Float32[np.ndarray, "h w 3"]
    changed: Bool[np.ndarray, "h w"]
    step: Int64[np.ndarray, "h w"]
    inconsistency: Float32[np.ndarray, "h w"]
    moving: Bool[np.ndarray, "s h w"]
    like_before: Bool[np.ndarray, "s h w"]
    like_after: Bool[np.ndarray, "s h w"]
    usual: Bool[np.ndarray, "s h w"]
    colors: UInt16[np.ndarray, "s h w"]
    camera: CameraMotion

    def nearest(self, frame: int) -> int:
        """Return the index of the picture that was compared and is nearest to a frame in time."""
        return int(np.abs(self.frames - frame).argmin())


def pixel_steps(frames: Sequence[UInt8[np.ndarray, "height width 3"]]) -> PixelSteps:
    """Compare the RGB pictures of a demonstration; see :class:`PixelSteps`."""
    count = len(frames)
    chosen = np.unique(np.linspace(0, count - 1, min(count, MAX_PICTURES)).round().astype(np.int64))
    pictures, seen, camera = _steady_labs(frames, chosen)
    at_end = max(1, min(MAX_END_PICTURES, round(END_RATIO * len(chosen))))
    before, after = (np.median(ends, axis=0) for ends in (pictures[:at_end], pictures[-at_end:]))
    difference = np.linalg.norm(after - before, axis=2)
    # Light that changes everywhere is no change of a place.
    changed = _opened(difference > max(MIN_CHANGE, 3.0 * float(np.median(difference)))) & seen
    step = np.zeros(changed.shape, np.int64)
    inconsistency = np.ones(changed.shape, np.float32)
    if changed.any():
        step[changed], inconsistency[changed] = _steps(
            pictures[:, changed], before[changed], after[changed], difference[changed]
        )
    # Picture by picture: all differences at once would take as much memory again as the pictures.
    motion = [np.linalg.norm(second - first, axis=2) for first, second in pairwise(pictures)]
    moving = np.zeros((len(chosen), *changed.shape), bool)
    noise = float(np.median(motion))
    moving[1:] = [_opened(picture > max(MIN_MOTION, 4.0 * noise)) & seen for picture in motion]
    typical = np.median(pictures[:: max(1, len(pictures) // TYPICAL_PICTURES)], axis=0)
    like_before, like_after, like_typical = (
        np.stack([_eroded(np.linalg.norm(picture - end, axis=2) < MIN_CHANGE) & seen for picture in pictures])
        for end in (before, after, typical)
    )
    return PixelSteps(
        chosen,
        before,
        after,
        changed,
        step,
        inconsistency,
        moving,
        like_before,
        like_after,
        usual=like_before | like_after | like_typical,
        colors=np.stack([color_bins(picture) for picture in pictures]),
        camera=camera,
    )


def _steady_labs(
    frames: Sequence[UInt8[np.ndarray, "height width 3"]], chosen: Int64[np.ndarray, " s"]
) -> tuple[Float32[np.ndarray, "s h w 3"], Bool[np.ndarray, "h w"], CameraMotion]:
    """Return some frames in Lab at the working size, exposed as the first of the demonstration and laid over it.

    With them, the pixels that all of them show, and how the camera moved.
    """
    scale = _scale(frames[0])
    reduced = [resized(frames[t], scale) for t in chosen.tolist()]
    transforms = camera_transforms([cv2.cvtColor(picture, cv2.COLOR_RGB2GRAY) for picture in reduced])
    height, width = reduced[0].shape[:2]
    first, seen = _blurred(reduced[0]), np.ones((height, width), bool)
    pictures = np.zeros((len(chosen), height, width, 3), np.float32)
    for number, transform in enumerate(transforms):  # not stacked from a list, which would take the memory twice
        picture = _blurred(reduced[number])
        if (transform != IDENTITY).any():
            picture, inside = (
                cv2.warpAffine(own, transform, (width, height), flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP)
                for own in (picture, np.ones((height, width), np.float32))
            )
            seen &= inside == 1.0
        pictures[number] = _lab(_exposed_as(first, picture))
    full = np.stack([resized_transform(transform, 1.0 / scale) for transform in transforms])
    return pictures, seen, CameraMotion(chosen, full)


def _scale(frame: UInt8[np.ndarray, "height width 3"]) -> float:
    return min(1.0, WORKING_SIDE / float(min(frame.shape[:2])))


def _blurred(picture: UInt8[np.ndarray, "h w 3"]) -> Float32[np.ndarray, "h w 3"]:
    """Return a picture in [0, 1], without its finest detail."""
    return np.asarray(cv2.GaussianBlur(picture.astype(np.float32) / 255.0, (0, 0), BLUR_PX), np.float32)


def _exposed_as(
    first: Float32[np.ndarray, "h w 3"], picture: Float32[np.ndarray, "h w 3"]
) -> Float32[np.ndarray, "h w 3"]:
    """Return a picture with the brightness and white balance of the first one, which a camera adjusts as it likes.

    Most of the picture is taken to be the same in both.
    """
    lit = (np.minimum(first, picture) > MIN_LIT).all(axis=2) & (np.maximum(first, picture) < MAX_LIT).all(axis=2)
    if not lit.any():
        return picture
    return np.asarray(picture * np.median(first[lit] / picture[lit], axis=0), np.float32)


def _lab(picture: Float32[np.ndarray, "h w 3"]) -> Float32[np.ndarray, "h w 3"]:
    return np.asarray(cv2.cvtColor(picture.clip(0.0, 1.0), cv2.COLOR_RGB2Lab), np.float32)


def _opened(mask: Bool[np.ndarray, "h w"]) -> Bool[np.ndarray, "h w"]:
    return np.asarray(cv2.morphologyEx(mask.astype(np.uint8), cv2.MORPH_OPEN, np.ones((3, 3))) > 0)


def _eroded(mask: Bool[np.ndarray, "h w"]) -> Bool[np.ndarray, "h w"]:
    return np.asarray(cv2.erode(mask.astype(np.uint8), np.ones((3, 3))) > 0)


def _steps(
    colors: Float32[np.ndarray, "s p 3"],
    before: Float32[np.ndarray, "p 3"],
    after: Float32[np.ndarray, "p 3"],
    difference: Float32[np.ndarray, " p"],
) -> tuple[Int64[np.ndarray, " p"], Float32[np.ndarray, " p"]]:
    """Return for each pixel the step that contradicts the fewest pictures, and the share of those that it does."""
    tolerance = np.minimum(difference / 2.0, MIN_CHANGE)
    none = np.zeros((1, len(before)), np.int64)
    unlike_before = np.linalg.norm(colors - before, axis=2) >= tolerance
    unlike_after = np.linalg.norm(colors - after, axis=2) >= tolerance
    contradictions = np.concatenate([none, unlike_before.cumsum(axis=0)])
    contradictions += np.concatenate([unlike_after[::-1].cumsum(axis=0)[::-1], none])
    share = contradictions.min(axis=0) / len(colors)
    return np.minimum(contradictions.argmin(axis=0), len(colors) - 1), share.astype(np.float32)
