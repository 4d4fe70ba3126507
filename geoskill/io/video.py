"""Frames from a video file, or from a stream of the network."""

import re
from collections.abc import Iterator
from pathlib import Path
from typing import final

import av

from geoskill.errors import InputError
from geoskill.io.decoding import VIDEO_TYPES, decoded_frames, nominal_rate, video_stream
from geoskill.io.frames import Frame, FrameSource, validate_frame_rate

# Seconds without data after which a stream counts as broken.
STREAM_TIMEOUT_S = 20.0


@final
class VideoFile(FrameSource):
    """The frames of a file's main video stream, turned and mirrored as players show them.

    Any file is read that PyAV decodes, whatever its name. Frame times are those stored in the file, relative to the
    first frame, whatever ``frame_rate`` is given; a frame without a time gets ``index / frame_rate``.

    A damaged or truncated video raises at the frame where it breaks, instead of passing for a shorter one. Detected are
    packets and frames that the decoder rejects or marks as damaged, and streams that end more than a second, and more
    than a tenth of the duration, before the duration stored in the file. Errors that the decoder makes up for, and
    single missing frames, are counted and said in a warning when all frames have been read.

    Args:
        path: the video file.
        frame_rate: nominal frames per second; None for the rate stored in the file.
        strict: refuse such errors and missing frames, too.

    Raises:
        InputError: when the file does not exist or is no video.
    """

    def __init__(self, path: str | Path, frame_rate: float | None = None, *, strict: bool = False) -> None:
        self._path = Path(path)
        self._strict = strict
        if not self._path.is_file():
            raise InputError(f"{path}: no such file; expected a video ({VIDEO_TYPES})")
        with self._open() as container:
            stored_rate = nominal_rate(container, video_stream(container, self.name))
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
        with self._open() as container:
            yield from decoded_frames(container, self.name, self._frame_rate, whole=True, strict=self._strict)

    def _open(self) -> av.container.InputContainer:
        try:
            # Of a relative path, FFmpeg takes what precedes a colon for a protocol; a title may be in any encoding.
            return av.open(str(self._path.absolute()), metadata_errors="replace")
        except av.error.FFmpegError as error:
            problem = "the file is empty" if self._path.stat().st_size == 0 else f"not readable ({error.strerror})"
            raise InputError(f"{self._path}: {problem}; expected a complete video file ({VIDEO_TYPES})") from error


@final
class VideoStream(FrameSource):
    """The frames of a URL that PyAV reads, such as ``rtsp://…`` or ``http://…``; a camera's have no end.

    Args:
        url: the address.
        frame_rate: nominal frames per second; None for the rate that the stream states.

    Attributes:
        is_live: whether it states no duration, as what a camera sends does.

    Raises:
        InputError: when it cannot be opened, or is no video.
    """

    def __init__(self, url: str, frame_rate: float | None = None) -> None:
        self._url = url
        with self._open() as container:
            self.is_live = container.duration is None
            stated_rate = nominal_rate(container, video_stream(container, self.name))
        self._frame_rate = validate_frame_rate(stated_rate if frame_rate is None else frame_rate)

    @property
    def name(self) -> str:
        """Return the address, without name and password of the user."""
        return re.sub(r"(?<=://)[^/@]*@", "", self._url)

    @property
    def frame_rate(self) -> float:
        """Return the nominal frames per second."""
        return self._frame_rate

    def __iter__(self) -> Iterator[Frame]:
        with self._open() as container:
            yield from decoded_frames(container, self.name, self._frame_rate, whole=not self.is_live)

    def _open(self) -> av.container.InputContainer:
        try:
            return av.open(self._url, timeout=STREAM_TIMEOUT_S, metadata_errors="replace")
        except (av.error.FFmpegError, ValueError) as error:
            reason = getattr(error, "strerror", None) or error
            raise InputError(f"{self.name}: cannot be opened ({reason}); expected the address of a video") from error
