"""Where frames come from: a folder of images, a video file or a camera.

Frames are RGB and come one by one, so a long video need not fit into memory. Every frame of a source has the same
size. What cannot be read is an :class:`~geoskill.errors.InputError` that names the file and what was expected; a source
never ends silently where its file breaks off.
"""

import contextlib
import math
import re
import time
from abc import ABC, abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import final

import av
import cv2
import numpy as np
from jaxtyping import UInt8

from geoskill.errors import InputError

IMAGE_SUFFIXES = (".jpg", ".jpeg", ".png", ".bmp", ".webp", ".tif", ".tiff")
VIDEO_SUFFIXES = (".mp4", ".mov", ".avi", ".webm", ".mkv")
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


@final
class ImageFolder(FrameSource):
    """The images of a folder in natural order of their names (``2.png`` before ``10.png``), hidden files left out.

    Raises:
        InputError: when the folder does not exist or holds no image, or the frame rate is not positive.
    """

    def __init__(self, path: str | Path, frame_rate: float = DEFAULT_FRAME_RATE) -> None:
        self._folder = Path(path)
        self._frame_rate = _checked_frame_rate(frame_rate)
        if not self._folder.is_dir():
            raise InputError(f"{path}: no such folder; expected a folder of images ({_listed(IMAGE_SUFFIXES)})")
        self._paths = sorted(
            (
                file
                for file in self._folder.iterdir()
                if file.suffix.lower() in IMAGE_SUFFIXES and not file.name.startswith(".")
            ),
            key=lambda file: _natural_key(file.name),
        )
        if not self._paths:
            raise InputError(f"{path}: the folder holds no image; expected {_listed(IMAGE_SUFFIXES)} files")

    @property
    def name(self) -> str:
        """See :attr:`FrameSource.name`."""
        return str(self._folder)

    @property
    def frame_rate(self) -> float:
        """See :attr:`FrameSource.frame_rate`."""
        return self._frame_rate

    def __iter__(self) -> Iterator[Frame]:
        first_shape: tuple[int, ...] | None = None
        for index, path in enumerate(self._paths):
            image = _read_image(path)
            first_shape = first_shape or image.shape
            if image.shape != first_shape:
                raise InputError(
                    f"{path}: the image is {_size(image.shape)} pixels; expected {_size(first_shape)} like "
                    f"{self._paths[0].name}, since the frames of a folder must have one size"
                )
            yield Frame(index, index / self._frame_rate, image)


@final
class VideoFile(FrameSource):
    """The frames of a file's main video stream, turned upright as the file's rotation says (by quarter turns).

    Times are those in the file, counted from the first frame, whatever ``frame_rate`` is given; frames without a time
    get ``index / frame_rate``.

    A video that breaks in the middle raises on the frame where it does, rather than passing for a shorter one. Found
    are packets and frames that the decoder rejects or marks as damaged, and streams that end at least a second and
    a tenth of the duration before the duration that the file states.

    Raises:
        InputError: when the file does not exist, is of an unsupported type or cannot be opened as a video.
    """

    def __init__(self, path: str | Path, frame_rate: float | None = None) -> None:
        self._path = Path(path)
        if not self._path.is_file():
            raise InputError(f"{path}: no such file; expected a video ({_listed(VIDEO_SUFFIXES)})")
        if self._path.suffix.lower() not in VIDEO_SUFFIXES:
            found = f"unsupported type {self._path.suffix!r}" if self._path.suffix else "no file type"
            raise InputError(f"{path}: {found}; expected a video ({_listed(VIDEO_SUFFIXES)}) or a folder of images")
        with self._opened() as container:
            stated = _video_stream(container, self._path).guessed_rate
        stated_rate = float(stated) if stated else DEFAULT_FRAME_RATE
        self._frame_rate = _checked_frame_rate(stated_rate if frame_rate is None else frame_rate)

    @property
    def name(self) -> str:
        """See :attr:`FrameSource.name`."""
        return str(self._path)

    @property
    def frame_rate(self) -> float:
        """See :attr:`FrameSource.frame_rate`."""
        return self._frame_rate

    def __iter__(self) -> Iterator[Frame]:
        index = 0
        start_s: float | None = None
        first_shape: tuple[int, ...] | None = None
        end_s = -math.inf
        with self._opened() as container:
            stream = _video_stream(container, self._path)
            try:
                # Packets of sound are read too: the duration that the file states is that of its longest stream.
                for packet in container.demux():
                    if packet.is_corrupt:
                        raise self._broken(index, "the data are damaged or cut off")
                    if packet.pts is not None and packet.time_base is not None:
                        end_s = max(end_s, float((packet.pts + (packet.duration or 0)) * packet.time_base))
                    for decoded in stream.decode(packet) if packet.stream.index == stream.index else ():
                        if decoded.is_corrupt:
                            raise self._broken(index, "the frame is damaged")
                        image = _upright(decoded)
                        first_shape = first_shape or image.shape
                        if image.shape != first_shape:
                            change = f"from {_size(first_shape)} to {_size(image.shape)} pixels"
                            raise self._broken(index, f"the size changes {change}")
                        time_s = index / self._frame_rate
                        if decoded.time is not None:
                            start_s = decoded.time - time_s if start_s is None else start_s
                            time_s = decoded.time - start_s
                        yield Frame(index, time_s, image)
                        index += 1
            except av.error.FFmpegError as error:
                raise self._broken(index, f"cannot be decoded ({error.strerror})") from error
            if index == 0:
                raise InputError(f"{self._path}: the video is empty; expected at least one frame that can be decoded")
            if container.duration is not None:
                duration_s = container.duration / av.time_base
                missing_s = duration_s + (container.start_time or 0) / av.time_base - end_s
                if missing_s > max(1.0, 0.1 * duration_s):
                    raise self._broken(index, f"{missing_s:.1f} of {duration_s:.1f} s are missing at the end")

    def _opened(self) -> av.container.InputContainer:
        try:
            return av.open(str(self._path))
        except av.error.FFmpegError as error:
            emptiness = "the file is empty" if self._path.stat().st_size == 0 else f"not readable ({error.strerror})"
            raise InputError(f"{self._path}: {emptiness}; expected a complete video file") from error

    def _broken(self, index: int, reason: str) -> InputError:
        return InputError(f"{self._path}: the video breaks at frame {index}: {reason}; expected a complete video file")


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
        self._frame_rate = _checked_frame_rate(stated_rate if frame_rate is None else frame_rate)

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
                yield Frame(index, now_s - start_s, _rgb(image))
                index += 1
        finally:
            capture.release()

    def _opened(self) -> cv2.VideoCapture:
        with _quiet_opencv():
            capture = cv2.VideoCapture(self._index)
        if not capture.isOpened():
            capture.release()
            raise InputError(f"{self.name}: cannot be opened; expected the index of a connected camera, such as 0")
        return capture


def open_frames(source: str | Path | int, frame_rate: float | None = None) -> FrameSource:
    """The source that a path or a camera's index names; a string of digits that is no existing path is a camera.

    Raises:
        InputError: when there is no such source, or it is none that can be read.
    """
    if isinstance(source, int):
        return Camera(source, frame_rate)
    path = Path(source)
    if str(source) and path.is_dir():
        return ImageFolder(path, DEFAULT_FRAME_RATE if frame_rate is None else frame_rate)
    if path.exists() and str(source):
        return VideoFile(path, frame_rate)
    if re.fullmatch(r"[0-9]+", str(source)):
        return Camera(int(str(source)), frame_rate)
    raise InputError(
        f"{str(source)!r} does not exist; expected a video ({_listed(VIDEO_SUFFIXES)}), a folder of images or a "
        "camera's index"
    )


def read_all(source: FrameSource, minimum: int = 2) -> list[Frame]:
    """All frames of a source that ends.

    Raises:
        InputError: when there are fewer than ``minimum``.
    """
    frames = list(source)
    if len(frames) < minimum:
        raise InputError(f"{source.name}: {len(frames)} frame(s); expected at least {minimum}")
    return frames


def _read_image(path: Path) -> UInt8[np.ndarray, "height width 3"]:
    try:
        # Read by Python, not by OpenCV, which cannot open every name on every system.
        data = np.frombuffer(path.read_bytes(), np.uint8)
        with _quiet_opencv():
            image = cv2.imdecode(data, cv2.IMREAD_COLOR) if data.size else None
    except (OSError, cv2.error) as error:
        raise InputError(f"{path}: cannot be read ({error}); expected an image") from error
    if image is None:
        raise InputError(f"{path}: not a readable image, or damaged; expected {_listed(IMAGE_SUFFIXES)}")
    return _rgb(image)


def _rgb(image: np.ndarray) -> UInt8[np.ndarray, "height width 3"]:
    return np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2RGB), np.uint8)


def _upright(frame: av.VideoFrame) -> UInt8[np.ndarray, "height width 3"]:
    quarter_turns = round(frame.rotation / 90)  # counterclockwise, as numpy's
    return np.ascontiguousarray(np.rot90(frame.to_ndarray(format="rgb24"), quarter_turns))


def _video_stream(container: av.container.InputContainer, path: Path) -> av.VideoStream:
    stream = container.streams.best("video")
    if not isinstance(stream, av.VideoStream):
        raise InputError(f"{path}: the file has no video stream; expected a video")
    return stream


@contextlib.contextmanager
def _quiet_opencv() -> Iterator[None]:
    """OpenCV prints its own account of what it could not read beside the one message that the user should see."""
    level = cv2.utils.logging.getLogLevel()
    cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)
    try:
        yield
    finally:
        cv2.utils.logging.setLogLevel(level)


def _natural_key(name: str) -> tuple[list[str | int], str]:
    # Split by a captured group: odd places are digits, so that words are never compared with numbers.
    parts = re.split(r"([0-9]+)", name.lower())
    return [int(part) if place % 2 else part for place, part in enumerate(parts)], name


def _checked_frame_rate(frame_rate: float) -> float:
    if not (math.isfinite(frame_rate) and frame_rate > 0):
        raise InputError(f"frame_rate is {frame_rate}; expected a positive number of frames per second")
    return float(frame_rate)


def _listed(suffixes: tuple[str, ...]) -> str:
    return ", ".join(suffix.removeprefix(".") for suffix in suffixes)


def _size(shape: tuple[int, ...]) -> str:
    return f"{shape[1]}x{shape[0]}"
