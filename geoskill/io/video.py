"""Frames from a folder of images or a video file."""

import math
import re
from collections.abc import Iterator
from pathlib import Path
from typing import final

import av
import cv2
import numpy as np
from jaxtyping import UInt8

from geoskill.errors import InputError
from geoskill.io.frames import DEFAULT_FRAME_RATE, Frame, FrameSource, bgr_to_rgb, quiet_opencv, validate_frame_rate

IMAGE_SUFFIXES = (".jpg", ".jpeg", ".png", ".bmp", ".webp", ".tif", ".tiff")
VIDEO_SUFFIXES = (".mp4", ".mov", ".avi", ".webm", ".mkv")
# As messages list them.
IMAGE_TYPES, VIDEO_TYPES = (
    ", ".join(suffix.removeprefix(".") for suffix in suffixes) for suffixes in (IMAGE_SUFFIXES, VIDEO_SUFFIXES)
)


@final
class ImageFolder(FrameSource):
    """The images of a folder in natural order of their names (``2.png`` before ``10.png``), without hidden files.

    Args:
        path: the folder.
        frame_rate: frames per second; frame ``i`` has the time ``i / frame_rate``.

    Raises:
        InputError: when the folder does not exist or holds no image, or the frame rate is not positive.
    """

    def __init__(self, path: str | Path, frame_rate: float = DEFAULT_FRAME_RATE) -> None:
        self._folder = Path(path)
        self._frame_rate = validate_frame_rate(frame_rate)
        if not self._folder.is_dir():
            raise InputError(f"{path}: no such folder; expected a folder of images ({IMAGE_TYPES})")
        self._paths = sorted(
            (
                file
                for file in self._folder.iterdir()
                if file.suffix.lower() in IMAGE_SUFFIXES and not file.name.startswith(".")
            ),
            key=lambda file: _natural_key(file.name),
        )
        if not self._paths:
            raise InputError(f"{path}: the folder holds no image; expected {IMAGE_TYPES} files")

    @property
    def name(self) -> str:
        """Return the path."""
        return str(self._folder)

    @property
    def frame_rate(self) -> float:
        """Return the nominal frames per second."""
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
    """The frames of a file's main video stream, turned upright by the rotation stored in the file (quarter turns).

    Frame times are those stored in the file, relative to the first frame, whatever ``frame_rate`` is given; a frame
    without a time gets ``index / frame_rate``.

    A damaged or truncated video raises at the frame where it breaks, instead of passing for a shorter one. Detected are
    packets and frames that the decoder rejects or marks as damaged, and streams that end more than a second, and more
    than a tenth of the duration, before the duration stored in the file.

    Args:
        path: the video file.
        frame_rate: nominal frames per second; None for the rate stored in the file.

    Raises:
        InputError: when the file does not exist, is of an unsupported type or cannot be opened as a video.
    """

    def __init__(self, path: str | Path, frame_rate: float | None = None) -> None:
        self._path = Path(path)
        if not self._path.is_file():
            raise InputError(f"{path}: no such file; expected a video ({VIDEO_TYPES})")
        if self._path.suffix.lower() not in VIDEO_SUFFIXES:
            problem = f"unsupported type {self._path.suffix!r}" if self._path.suffix else "no file type"
            raise InputError(f"{path}: {problem}; expected a video ({VIDEO_TYPES}) or a folder of images")
        with self._open() as container:
            guessed_rate = _video_stream(container, self._path).guessed_rate
        stored_rate = float(guessed_rate) if guessed_rate else DEFAULT_FRAME_RATE
        self._frame_rate = validate_frame_rate(stored_rate if frame_rate is None else frame_rate)

    @property
    def name(self) -> str:
        """Return the path."""
        return str(self._path)

    @property
    def frame_rate(self) -> float:
        """Return the nominal frames per second."""
        return self._frame_rate

    def __iter__(self) -> Iterator[Frame]:
        index = 0
        start_s: float | None = None
        first_shape: tuple[int, ...] | None = None
        end_s = -math.inf
        with self._open() as container:
            stream = _video_stream(container, self._path)
            try:
                # Audio packets are read too: the duration stored in the file is that of its longest stream.
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

    def _open(self) -> av.container.InputContainer:
        try:
            return av.open(str(self._path), metadata_errors="replace")  # a title may be in any encoding
        except av.error.FFmpegError as error:
            problem = "the file is empty" if self._path.stat().st_size == 0 else f"not readable ({error.strerror})"
            raise InputError(f"{self._path}: {problem}; expected a complete video file") from error

    def _broken(self, index: int, reason: str) -> InputError:
        return InputError(f"{self._path}: the video breaks at frame {index}: {reason}; expected a complete video file")


def _read_image(path: Path) -> UInt8[np.ndarray, "height width 3"]:
    try:
        # Read by Python, because OpenCV cannot open every file name on every system.
        data = np.frombuffer(path.read_bytes(), np.uint8)
        with quiet_opencv():
            image = cv2.imdecode(data, cv2.IMREAD_COLOR) if data.size else None
    except (OSError, cv2.error) as error:
        raise InputError(f"{path}: cannot be read ({error}); expected an image") from error
    if image is None:
        raise InputError(f"{path}: not a readable image, or damaged; expected {IMAGE_TYPES}")
    return bgr_to_rgb(image)


def _upright(frame: av.VideoFrame) -> UInt8[np.ndarray, "height width 3"]:
    quarter_turns = round(frame.rotation / 90)  # counterclockwise, as numpy's
    return np.ascontiguousarray(np.rot90(frame.to_ndarray(format="rgb24"), quarter_turns))


def _video_stream(container: av.container.InputContainer, path: Path) -> av.VideoStream:
    stream = container.streams.best("video")
    if not isinstance(stream, av.VideoStream):
        raise InputError(f"{path}: the file has no video stream; expected a video")
    return stream


def _natural_key(name: str) -> tuple[list[str | int], str]:
    # The captured group puts numbers at odd positions, so that words are never compared with numbers.
    tokens = re.split(r"([0-9]+)", name.lower())
    return [int(token) if position % 2 else token for position, token in enumerate(tokens)], name


def _size(shape: tuple[int, ...]) -> str:
    return f"{shape[1]}x{shape[0]}"
