"""Frames, and the interface of everything that yields them.

Frames are RGB and are read one at a time, so a long video need not fit into memory. All frames of a source have the
same size. Unreadable input raises :class:`~geoskill.errors.InputError`, which names the file and what was expected;
a source never ends silently where its file is truncated.
"""

import contextlib
from abc import ABC, abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass
from typing import final

import cv2
import numpy as np
from jaxtyping import Float, UInt8

from geoskill.config import MAX_FRAME_RATE, MIN_FRAME_RATE
from geoskill.errors import InputError
from geoskill.geometry.depth_camera import DepthCamera
from geoskill.geometry.depth_picture import DepthPicture

DEFAULT_FRAME_RATE = 30.0
EXPECTED_DEPTH = (
    "expected a folder with depth/ and camera.yaml beside its pictures, or a simulated task with task.depth=d435"
)
"""What to do where depth is needed, for messages."""


@final
@dataclass(frozen=True, eq=False)
class Frame:
    """One picture of a source.

    Attributes:
        index: 0 for the first frame that the source yields.
        time_s: seconds after the first frame.
        image: RGB.
        depth_m: distance of each pixel from the camera along its axis, in meters, aligned with the picture; NaN where
            there is none. None where the source has no depth.
        depth_camera: the intrinsics of the picture; None where the source has no depth.

    Raises:
        ValueError: when the depth is of another size than the picture or no depth, or has no camera.
    """

    index: int
    time_s: float
    image: UInt8[np.ndarray, "height width 3"]
    depth_m: Float[np.ndarray, "rows columns"] | None = None
    depth_camera: DepthCamera | None = None

    def __post_init__(self) -> None:
        if self.depth_m is None:
            return
        if self.depth_camera is None:
            raise ValueError(f"frame {self.index} has depth and no depth_camera; expected the picture's intrinsics")
        if self.depth_m.shape != self.image.shape[:2] or not np.issubdtype(self.depth_m.dtype, np.floating):
            raise ValueError(
                f"depth_m of frame {self.index} is {self.depth_m.dtype} {list(self.depth_m.shape)}; expected meters"
                f" {list(self.image.shape[:2])} of floating point, as large as the picture"
            )
        nearest, farthest = (
            float(np.fmin.reduce(self.depth_m, axis=None)),
            float(np.fmax.reduce(self.depth_m, axis=None)),
        )
        if nearest <= 0 or np.isinf(farthest):
            raise ValueError(
                f"depth_m of frame {self.index} is {nearest if nearest <= 0 else farthest:g} somewhere; expected meters"
                " above 0, and NaN where there is none"
            )

    @property
    def depth(self) -> DepthPicture | None:
        """Depth with its camera; None without."""
        if self.depth_m is None or self.depth_camera is None:
            return None
        return DepthPicture(self.depth_m, self.depth_camera)

    @property
    def nbytes(self) -> int:
        """Bytes that picture and depth take."""
        return self.image.nbytes + (0 if self.depth_m is None else self.depth_m.nbytes)


class FrameSource(ABC):
    """A sequence of frames, read lazily, from the first one at each iteration (a camera: from the present on)."""

    @property
    @abstractmethod
    def name(self) -> str:
        """Return the name that the user gave the source, for messages and titles."""

    @property
    @abstractmethod
    def frame_rate(self) -> float:
        """Return the nominal frames per second."""

    @abstractmethod
    def __iter__(self) -> Iterator[Frame]:
        """Yield the frames in order of time.

        Raises:
            InputError: when a frame cannot be read, there is none, or its size differs from the first frame's.
        """


def validate_frame_rate(frame_rate: float) -> float:
    """Return the frame rate (frames per second) if it is valid.

    Raises:
        InputError: when it is not from 0.01 to 10,000.
    """
    if not MIN_FRAME_RATE <= frame_rate <= MAX_FRAME_RATE:
        raise InputError(
            f"frame_rate is {frame_rate:g}; expected frames per second from {MIN_FRAME_RATE:g} to {MAX_FRAME_RATE:g}"
        )
    return float(frame_rate)


def size_text(shape: tuple[int, ...]) -> str:
    """Return the size of a picture of this shape as messages have it, such as ``640x480``."""
    return f"{shape[1]}x{shape[0]}"


def bgr_to_rgb(image: np.ndarray) -> UInt8[np.ndarray, "height width 3"]:
    """Convert a color picture from OpenCV's order of channels to RGB."""
    return np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2RGB), np.uint8)


@contextlib.contextmanager
def quiet_opencv() -> Iterator[None]:
    """Silence OpenCV's log in the block, so that the user sees only our own message about unreadable input."""
    level = cv2.utils.logging.getLogLevel()
    cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)
    try:
        yield
    finally:
        cv2.utils.logging.setLogLevel(level)
