"""The demonstrations of ``task=video``: recordings, or parts of them."""

from dataclasses import dataclass
from typing import Any, final

from geoskill.cli.inputs import open_recording
from geoskill.cli.schemas import VideoTaskConfig
from geoskill.errors import InputError
from geoskill.io.choice import Choice
from geoskill.io.frames import FrameSource
from geoskill.io.segment import Position, Segment


@final
@dataclass(frozen=True)
class Part:
    """A recording or a part of it.

    Attributes:
        path: of the recording, as the user gave it.
        choice: which recording, where the path holds several.
        start: first frame, or None.
        end: frame before which it ends, or None.
        stride: of so many frames, one is taken.
    """

    path: Any
    choice: Choice
    start: Position | None
    end: Position | None
    stride: int

    @property
    def is_whole(self) -> bool:
        """Whether it is the whole recording."""
        return self.start is None and self.end is None and self.stride == 1

    def open(self, frame_rate: float | None, *, strict_video: bool = False) -> FrameSource:
        """Open it; see :func:`~geoskill.cli.inputs.open_recording`."""
        if not isinstance(self.path, str | int) or isinstance(self.path, bool):
            raise InputError(f"task.path: {self.path} is no path; expected a folder of images or a video file")
        recording = open_recording(self.path, frame_rate, self.choice, strict_video=strict_video)
        return recording if self.is_whole else Segment(recording, self.start, self.end, self.stride)


def parts_of(task: VideoTaskConfig) -> list[Part]:
    """Return the demonstrations of a task: of paths, episodes, starts and ends, single ones serve all.

    Raises:
        InputError: when a start or an end is none, or there are not as many of them as of the others.
    """
    keys = "path", "episode", "start", "end"
    given = {f"task.{key}": _listed(getattr(task, key)) for key in keys}
    if not given["task.path"]:
        return []
    count = max(map(len, given.values()))
    for key, values in given.items():
        if len(values) not in (1, count):
            raise InputError(f"{key}: there are {len(values)}; expected one, or {count} as of the others")
    same = (values * count if len(values) == 1 else values for values in given.values())
    return [
        Part(
            path,
            Choice(_episode(episode), task.camera, task.topic, prefix="task."),
            _position("task.start", start),
            _position("task.end", end),
            task.stride,
        )
        for path, episode, start, end in zip(*same, strict=True)
    ]


def _listed(value: Any) -> list[Any]:
    return list(value) if isinstance(value, list | tuple) else [value]


def _episode(value: Any) -> int | None:
    if value is not None and (not isinstance(value, int) or isinstance(value, bool) or value < 0):
        raise InputError(f"task.episode={value}: expected a whole number of at least 0, or several, [0,3]")
    return value


def _position(key: str, value: Any) -> Position | None:
    return None if value is None else Position.parse(key, value)
