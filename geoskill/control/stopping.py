"""When the loop is done: the error is at the level of noise, or no longer falls."""

from collections.abc import Sequence
from typing import Final

import numpy as np

from geoskill.control.rows import Row
from geoskill.geometry.uncertainty import DETECTION_STD_PX

NOISE_LEVEL_PX: Final = 2.2 * DETECTION_STD_PX
LEVEL_FRAMES: Final = 5
STALL_FRAMES: Final = 10
STALL_SPAN: Final = 20
STALL_RATIO: Final = 0.93
TERMINAL_FRAMES: Final = 30
"""Frames with a falling gain after that: they average the noise of detection."""
TERMINAL_SLOWNESS: Final = 6.0
GROWTH_FRAMES: Final = 10
GROWING_SHARE: Final = 0.8
GROWN_RATIO: Final = 1.5
GROWN_PX: Final = 10.0
GATE: Final = 5.0
"""Error of an association at the end over the usual RMS, beyond which it is wrong."""


def is_settled(history: Sequence[float], level_px: float = NOISE_LEVEL_PX) -> bool:
    """Return whether the error has come to rest.

    Args:
        history: weighted RMS of the errors, frame by frame.
        level_px: where nothing is left to be done.

    >>> is_settled([9.0, 3.0, 1.0, 0.9, 1.0]), is_settled([9.0, 3.0, 1.0]), is_settled([5.0] * 30)
    (True, False, True)
    """
    if len(history) >= LEVEL_FRAMES and float(np.median(history[-LEVEL_FRAMES:])) < level_px:
        return True
    if len(history) < STALL_FRAMES + STALL_SPAN:
        return False
    earlier = history[-STALL_FRAMES - STALL_SPAN : -STALL_SPAN]
    return float(np.mean(history[-STALL_FRAMES:])) > STALL_RATIO * float(np.mean(earlier))


def is_growing(history: Sequence[float]) -> bool:
    """Return whether the error has grown clearly in the last frames, in nearly every one of them.

    >>> is_growing([20.0 + 3 * frame for frame in range(11)]), is_growing([20.0 - frame for frame in range(11)])
    (True, False)
    """
    if len(history) <= GROWTH_FRAMES:
        return False
    recent = np.array(history[-GROWTH_FRAMES - 1 :])
    far = recent[-1] > max(GROWN_PX, GROWN_RATIO * recent[0])
    return bool(far and (np.diff(recent) > 0).mean() >= GROWING_SHARE)


def near_goal(rows: Sequence[Row], history: Sequence[float]) -> list[Row]:
    """Return the rows whose errors are of the size that was seen in the last frames.

    At the end the carried thing stays where it is, so an association that is suddenly far off is a wrong one.
    """
    usual = float(np.median(history[-STALL_FRAMES:])) if history else 0.0
    largest = GATE * max(usual, NOISE_LEVEL_PX)
    return [row for row in rows if float(np.linalg.norm(row.error)) <= largest]


def terminal_gain(gain: float, frame: int) -> float:
    """Return the gain of a terminal frame, counted from 0.

    >>> terminal_gain(0.35, 0), terminal_gain(0.35, 6)
    (0.35, 0.175)
    """
    return gain / (1 + frame / TERMINAL_SLOWNESS)


def averaging(gain: float, frames: int) -> float:
    """Return the variance that noise of variance 1 leaves in the pose, after terminal frames with a falling gain.

    >>> round(averaging(0.35, 0), 4), averaging(0.35, 30) < 0.06
    (0.2121, True)
    """
    variance = gain / (2 - gain)  # of a loop that has run for long with a constant gain
    for frame in range(frames):
        own = terminal_gain(gain, frame)
        variance = (1 - own) ** 2 * variance + own**2
    return variance
