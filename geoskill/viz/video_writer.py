"""Writing of H.264 video that every browser and player shows."""

from collections.abc import Sequence
from contextlib import ExitStack
from fractions import Fraction
from pathlib import Path
from types import TracebackType
from typing import final

import av
import numpy as np
from jaxtyping import UInt8

from geoskill.errors import InputError
from geoskill.io.atomic import atomic_path
from geoskill.io.frames import validate_frame_rate

CONTAINER_SUFFIXES = (".mp4", ".mov", ".mkv")
# The first one that the installed av was built with; the others encode in software or come with an operating system.
# Of time stamps; every usual frame rate divides it.
CLOCK_HZ = 90000
# Longest time for which the last frame is shown; a recording of few frames ends shortly after its last one, too.
MAX_LAST_S = 0.1
H264_ENCODERS = ("libx264", "libopenh264", "h264_videotoolbox", "h264_mf")


@final
class VideoWriter:
    """Writes RGB frames of one size to a video, which appears under its name only once it is complete.

    Use it as a context manager. Frames go to a hidden file beside ``path`` that takes its name on leaving the block;
    an exception, Ctrl-C included, removes it and leaves a file of an earlier run as it was. A loop that is meant to end
    by Ctrl-C catches it inside the block. Without any frame nothing is written either.

    H.264 with 4:2:0 chroma needs even sizes: an odd one is padded by repeating the last column or row, so pixel
    coordinates stay as they are.

    Args:
        path: the video file.
        frame_rate: nominal frames per second: times of frames that are given none.

    Raises:
        InputError: when the name's ending is no video container's, its folder does not exist, or the frame rate is
            out of range.
        RuntimeError: when the installed av has no H.264 encoder.
    """

    def __init__(self, path: str | Path, frame_rate: float) -> None:
        self._path = Path(path)
        if self._path.suffix.lower() not in CONTAINER_SUFFIXES:
            raise InputError(f"{path}: cannot write this type of file; expected {', '.join(CONTAINER_SUFFIXES)}")
        if not self._path.parent.is_dir():
            raise InputError(f"{path}: its folder does not exist; expected an existing one")
        self._frame_rate = Fraction(validate_frame_rate(frame_rate)).limit_denominator(1001)
        self._encoder = _available_encoder()
        self._stack = ExitStack()
        self._container: av.container.OutputContainer | None = None
        self._stream: av.VideoStream | None = None
        self._shape: tuple[int, ...] = ()
        self._count = 0
        self._last = -1

    def __enter__(self) -> "VideoWriter":
        return self

    def write(self, image: UInt8[np.ndarray, "height width 3"], time_s: float | None = None) -> None:
        """Append a frame.

        Args:
            image: RGB.
            time_s: seconds after the first frame; None for the nominal frame rate. It comes after the frame before it
                by at least a tick of the clock, whatever is given.

        Raises:
            ValueError: when it is not 8-bit RGB or not of the first frame's size.
        """
        if image.dtype != np.uint8 or image.ndim != 3 or image.shape[2] != 3 or image.size == 0:
            raise ValueError(f"the frame is {image.dtype} {image.shape}; expected uint8 [height, width, 3]")
        self._shape = self._shape or image.shape
        if image.shape != self._shape:
            raise ValueError(f"frame {self._count} has shape {image.shape}; expected {self._shape} like the first one")
        padded = np.pad(image, ((0, image.shape[0] % 2), (0, image.shape[1] % 2), (0, 0)), mode="edge")
        container, stream = self._opened(padded.shape[1], padded.shape[0])
        frame = av.VideoFrame.from_ndarray(np.ascontiguousarray(padded), format="rgb24")
        due_s = self._count / self._frame_rate if time_s is None else time_s
        frame.pts = max(round(due_s * CLOCK_HZ), self._last + 1)
        frame.time_base = Fraction(1, CLOCK_HZ)
        self._mux(container, stream.encode(frame))
        self._last = frame.pts
        self._count += 1

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        # In this order: the last frames are encoded, the container is closed, and the file gets its name.
        self._stack.__exit__(kind, error, traceback)

    def _flush(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        if error is None and self._container is not None and self._stream is not None:
            self._mux(self._container, self._stream.encode(None))

    def _mux(self, container: av.container.OutputContainer, packets: Sequence["av.Packet[av.VideoStream]"]) -> None:
        for packet in packets:  # only that of the last one counts
            if packet.time_base is not None:
                packet.duration = round(min(float(1 / self._frame_rate), MAX_LAST_S) / packet.time_base)
        container.mux(packets)

    def _opened(self, width: int, height: int) -> tuple[av.container.OutputContainer, av.VideoStream]:
        if self._container is None or self._stream is None:
            # The index in front lets a browser play the file while it loads.
            temporary = self._stack.enter_context(atomic_path(self._path))
            self._container = av.open(str(temporary), "w", options={"movflags": "faststart"})
            self._stack.enter_context(self._container)
            self._stack.push(self._flush)
            stream = self._container.add_stream(self._encoder, rate=self._frame_rate)
            if not isinstance(stream, av.VideoStream):
                raise RuntimeError(f"encoder {self._encoder} made a {stream.type} stream; expected video")
            stream.width, stream.height, stream.pix_fmt = width, height, "yuv420p"
            stream.codec_context.time_base = Fraction(1, CLOCK_HZ)
            stream.codec_context.max_b_frames = 0  # MP4 takes the length from the last packet, not from the last frame
            if self._encoder == "libx264":
                stream.options = {"crf": "18", "preset": "veryfast"}  # thin lines need the quality
            self._stream = stream
            self._container.start_encoding()  # so that what cannot be written fails on the first frame
        return self._container, self._stream


def _available_encoder() -> str:
    for name in H264_ENCODERS:
        try:
            av.Codec(name, "w")
        except ValueError:
            continue
        return name
    raise RuntimeError(
        f"the installed av {av.__version__} has no H.264 encoder ({', '.join(H264_ENCODERS)}); install av from PyPI"
    )
