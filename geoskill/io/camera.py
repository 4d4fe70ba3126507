"""Frames from a camera of this machine."""

import math
import time
from collections.abc import Iterator
from typing import final

import cv2

from geoskill.errors import InputError
from geoskill.io.frames import DEFAULT_FRAME_RATE, Frame, FrameSource, checked_frame_rate, quiet_opencv, rgb


@final
class Camera(FrameSource):
    """A camera of this machine, by index; endless, or until ``max_frames``.

    Times are those at which the frames arrived. Ctrl-C raises ``KeyboardInterrupt`` from wherever the program is at
    that moment, so it is for the loop over the frames to catch; the camera is released all the same.

    Raises:
        InputError: when the camera cannot be opened.
    """

    def __init__(self, index: int, frame_rate: float | None = None, max_frames: int | None = None) -> None:
        self._index = index
        self._max_frames = max_frames
        capture = self._opened()
        try:
            stated = capture.get(cv2.CAP_PROP_FPS)
        finally:
            capture.release()
        # Drivers that do not know their rate say 0, -1 or NaN.
        stated_rate = stated if stated > 0 and math.isfinite(stated) else DEFAULT_FRAME_RATE
        self._frame_rate = checked_frame_rate(stated_rate if frame_rate is None else frame_rate)

    @property
    def name(self) -> str:
        """See :attr:`FrameSource.name`."""
        return f"camera {self._index}"

    @property
    def frame_rate(self) -> float:
        """See :attr:`FrameSource.frame_rate`."""
        return self._frame_rate

    def __iter__(self) -> Iterator[Frame]:
        capture = self._opened()
        try:
            index = 0
            start_s: float | None = None
            while self._max_frames is None or index < self._max_frames:
                arrived, image = capture.read()
                now_s = time.monotonic()
                if not arrived:
                    raise InputError(f"{self.name}: no picture after {index} frames; expected it to stay connected")
                start_s = now_s if start_s is None else start_s
                yield Frame(index, now_s - start_s, rgb(image))
                index += 1
        finally:
            capture.release()

    def _opened(self) -> cv2.VideoCapture:
        with quiet_opencv():
            capture = cv2.VideoCapture(self._index)
        if not capture.isOpened():
            capture.release()
            raise InputError(f"{self.name}: cannot be opened; expected the index of a connected camera, such as 0")
        return capture
