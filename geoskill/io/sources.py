"""Opening of frame sources by the name that the user gives."""

import re
from pathlib import Path

from geoskill.errors import InputError
from geoskill.io.camera import Camera
from geoskill.io.frames import DEFAULT_FRAME_RATE, Frame, FrameSource
from geoskill.io.video import VIDEO_TYPES, ImageFolder, VideoFile


def open_frames(source: str | Path | int, frame_rate: float | None = None) -> FrameSource:
    """Open a video, a folder of images, or a camera by its index.

    A string of digits is a camera's index unless a file or folder of that name exists.

    Raises:
        InputError: when there is no such source, or it cannot be read.
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
        f"{str(source)!r} does not exist; expected a video ({VIDEO_TYPES}), a folder of images or a camera's index"
    )


def read_all(source: FrameSource, minimum: int = 2) -> list[Frame]:
    """Read all frames of a finite source.

    Raises:
        InputError: when there are fewer than ``minimum``.
    """
    frames = list(source)
    if len(frames) < minimum:
        raise InputError(f"{source.name}: {len(frames)} frame(s); expected at least {minimum}")
    return frames
