"""Frames from a camera of this computer."""

import math
import time
from collections.abc import Iterator
from typing import final

import cv2

from geoskill.errors import InputError
from geoskill.io.frames import DEFAULT_FRAME_RATE, Frame, FrameSource, bgr_to_rgb, quiet_opencv, validate_frame_rate


@final
class Camera(FrameSource):
    """A camera of this computer; endless unless ``max_frames`` is given.

    Frame times are arrival times. Ctrl-C raises ``KeyboardInterrupt`` wherever the program is at that moment, so the
    loop over the frames has to catch it; the camera is released in any case.

    Args:
        index: number of the camera, from 0, or its device file, such as ``/dev/video0``.
        frame_rate: nominal frames per second; None for the rate that the driver reports.
        max_frames: number of frames after which iteration ends; None for no end.

    Raises:
        InputError: when the camera cannot be opened.
    """

    def __init__(self, index: int | str, frame_rate: float | None = None, max_frames: int | None = None) -> None:
        self._index = index
        self._max_frames = max_frames
        capture = self._open()
        try:
            reported_rate = capture.get(cv2.CAP_PROP_FPS)
        finally:
            capture.release()
        # Drivers that do not know their rate report 0, -1 or NaN.
        if not (reported_rate > 0 and math.isfinite(reported_rate)):
            reported_rate = DEFAULT_FRAME_RATE
        self._frame_rate = validate_frame_rate(reported_rate if frame_rate is None else frame_rate)

    @property
    def name(self) -> str:
        """Return the camera's name, such as ``camera 0`` or ``/dev/video0``."""
        return f"camera {self._index}" if isinstance(self._index, int) else self._index

    @property
    def frame_rate(self) -> float:
        """Return the nominal frames per second."""
        return self._frame_rate

    def __iter__(self) -> Iterator[Frame]:
        capture = self._open()
        try:
            index = 0
            start_s: float | None = None
            first_shape: tuple[int, ...] | None = None
            while self._max_frames is None or index < self._max_frames:
                arrived, image = capture.read()
                now_s = time.monotonic()
                if not arrived:
                    raise InputError(f"{self.name}: no picture after {index} frames; expected it to stay connected")
                first_shape = first_shape or image.shape
                if image.shape != first_shape:
                    raise InputError(
                        f"{self.name}: frame {index} is {_size(image.shape)} pixels; expected {_size(first_shape)}, as"
                        " before (another program may have set the camera)"
                    )
                start_s = now_s if start_s is None else start_s
                yield Frame(index, now_s - start_s, bgr_to_rgb(image))
                index += 1
        finally:
            capture.release()

    def _open(self) -> cv2.VideoCapture:
        with quiet_opencv():
            capture = cv2.VideoCapture(self._index)
        if not capture.isOpened():
            capture.release()
            raise InputError(f"{self.name}: cannot be opened; expected the index of a connected camera, such as 0")
        return capture


def _size(shape: tuple[int, ...]) -> str:
    return f"{shape[1]}x{shape[0]}"
