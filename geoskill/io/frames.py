"""What frames are, and what everything that yields them offers.

Frames are RGB and come one by one, so a long video need not fit into memory. Every frame of a source has the same
size. What cannot be read is an :class:`~geoskill.errors.InputError` that names the file and what was expected; a source
never ends silently where its file breaks off.
"""

import contextlib
import math
from abc import ABC, abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass
from typing import final

import cv2
import numpy as np
from jaxtyping import UInt8

from geoskill.errors import InputError

DEFAULT_FRAME_RATE = 30.0


@final
@dataclass(frozen=True, eq=False)
class Frame:
    """One picture of a source.

    Attributes:
        index: 0 for the first frame that the source yields.
        time_s: seconds after the first frame.
        image: RGB.
    """

    index: int
    time_s: float
    image: UInt8[np.ndarray, "height width 3"]


class FrameSource(ABC):
    """Yields frames lazily, from the first one each time it is iterated (a camera: from now on)."""

    @property
    @abstractmethod
    def name(self) -> str:
        """What the user called it, for messages and titles."""

    @property
    @abstractmethod
    def frame_rate(self) -> float:
        """Frames per second, nominal."""

    @abstractmethod
    def __iter__(self) -> Iterator[Frame]:
        """The frames in order of time.

        Raises:
            InputError: where a frame cannot be read, there is none, or its size is not the first one's.
        """


def checked_frame_rate(frame_rate: float) -> float:
    """The frame rate, in frames per second.

    Raises:
        InputError: when it is not positive and finite.
    """
    if not (math.isfinite(frame_rate) and frame_rate > 0):
        raise InputError(f"frame_rate is {frame_rate}; expected a positive number of frames per second")
    return float(frame_rate)


def rgb(image: np.ndarray) -> UInt8[np.ndarray, "height width 3"]:
    """A color picture as OpenCV reads it, with its channels in our order."""
    return np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2RGB), np.uint8)


@contextlib.contextmanager
def quiet_opencv() -> Iterator[None]:
    """OpenCV prints its own account of what it could not read beside the one message that the user should see."""
    level = cv2.utils.logging.getLogLevel()
    cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)
    try:
        yield
    finally:
        cv2.utils.logging.setLogLevel(level)
