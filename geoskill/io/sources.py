"""Opening of frame sources by the name that the user gives."""

import re
from pathlib import Path

from geoskill.errors import InputError
from geoskill.io.bag import BagTopic, is_bag
from geoskill.io.camera import Camera
from geoskill.io.choice import Choice
from geoskill.io.decoding import VIDEO_TYPES
from geoskill.io.depth_folder import DepthFolder, has_depth
from geoskill.io.frames import DEFAULT_FRAME_RATE, FrameSource
from geoskill.io.image_folder import ImageFolder
from geoskill.io.kept_frames import KeptFrames
from geoskill.io.lerobot import LeRobotEpisode, is_lerobot
from geoskill.io.video import VideoFile, VideoStream

# Bare small numbers; a larger one, or one with zeros in front, rather is the name of a folder that is not there.
CAMERA_NUMBER = re.compile(r"0|[1-9][0-9]?")
URL = re.compile(r"[a-zA-Z][a-zA-Z0-9+.-]*://.+")


def open_frames(
    source: str | Path | int,
    frame_rate: float | None = None,
    choice: Choice | None = None,
    *,
    strict_video: bool = False,
) -> FrameSource:
    """Open a recording, a camera by its number or device file, or the address of a stream.

    A recording is a video, a folder of images, an episode of a LeRobot data set or an image topic of a bag of ROS 2. A
    folder with ``depth/`` and ``camera.yaml`` has depth beside its pictures. A number of at most two digits is a
    camera's unless a file or folder of that name exists.

    Args:
        source: which one.
        frame_rate: nominal frames per second; None for those of the source, or 30.
        choice: which recording of a data set or bag that holds several.
        strict_video: refuse a video file with errors that its decoder makes up for, or with missing frames.

    Raises:
        InputError: when there is no such source, it cannot be read, or has no such choice.
    """
    choice = Choice() if choice is None else choice
    recorded = _opened_data_set(source, frame_rate, choice)
    if recorded is not None:
        return recorded
    choice.require_unused(str(source), "episode", "camera", "topic")
    if isinstance(source, int):
        return Camera(source, frame_rate)
    path, name = Path(source), str(source)
    try:
        exists = name != "" and path.exists()
    except (OSError, ValueError):  # too long, or with a zero byte
        exists = False
    if exists and path.is_dir():
        frame_rate = DEFAULT_FRAME_RATE if frame_rate is None else frame_rate
        return DepthFolder(path, frame_rate) if has_depth(path) else ImageFolder(path, frame_rate)
    if exists and path.is_char_device():
        return Camera(name, frame_rate)
    if exists:
        return VideoFile(path, frame_rate, strict=strict_video)
    if CAMERA_NUMBER.fullmatch(name):
        return Camera(int(name), frame_rate)
    if URL.fullmatch(name):
        return VideoStream(name, frame_rate)
    raise InputError(
        f"{name!r} does not exist; expected a video ({VIDEO_TYPES}), a folder of images, a LeRobot data set, a bag of"
        " ROS 2, a camera's index or a URL"
    )


def _opened_data_set(source: str | Path | int, frame_rate: float | None, choice: Choice) -> FrameSource | None:
    """Open what holds several recordings; None where ``source`` is nothing of the kind."""
    try:
        path = None if isinstance(source, int) else Path(source)
        if path is None or not path.exists():
            return None
    except (OSError, ValueError):
        return None
    if path.is_dir() and is_lerobot(path):
        choice.require_unused(str(source), "topic")
        return LeRobotEpisode(path, choice, frame_rate)
    if (path.is_dir() or path.is_file()) and is_bag(path):
        choice.require_unused(str(source), "episode", "camera")
        return BagTopic(path, choice, frame_rate)
    return None


def is_live(source: FrameSource) -> bool:
    """Return whether the frames come as they are recorded, without an end."""
    return isinstance(source, Camera) or (isinstance(source, VideoStream) and source.is_live)


def read_all(source: FrameSource, minimum: int = 2) -> KeptFrames:
    """Read all frames of a finite source, unless that has been done.

    Raises:
        InputError: when there are fewer than ``minimum``.
    """
    if isinstance(source, KeptFrames) and len(source) >= minimum:
        return source
    return KeptFrames(source, minimum)
