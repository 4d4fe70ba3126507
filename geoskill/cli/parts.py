"""The demonstrations of ``task=video``: recordings, or parts of them."""

from dataclasses import dataclass
from typing import Any, final

from geoskill.cli.inputs import open_recording
from geoskill.cli.schemas import VideoTaskConfig
from geoskill.errors import InputError
from geoskill.io.frames import FrameSource
from geoskill.io.segment import Position, Segment


@final
@dataclass(frozen=True)
class Part:
    """A recording or a part of it.

    Attributes:
        path: of the recording, as the user gave it.
        start: first frame, or None.
        end: frame before which it ends, or None.
        stride: of so many frames, one is taken.
    """

    path: Any
    start: Position | None
    end: Position | None
    stride: int

    @property
    def is_whole(self) -> bool:
        """Whether it is the whole recording."""
        return self.start is None and self.end is None and self.stride == 1

    def open(self, frame_rate: float | None) -> FrameSource:
        """Open it; see :func:`~geoskill.cli.inputs.open_recording`."""
        if not isinstance(self.path, str | int) or isinstance(self.path, bool):
            raise InputError(f"task.path: {self.path} is no path; expected a folder of images or a video file")
        recording = open_recording(self.path, frame_rate)
        return recording if self.is_whole else Segment(recording, self.start, self.end, self.stride)


def parts_of(task: VideoTaskConfig) -> list[Part]:
    """Return the demonstrations of a task: of paths, starts and ends, single ones serve all.

    Raises:
        InputError: when a start or an end is none, or there are not as many of them as of the others.
    """
    given = {"task.path": _listed(task.path), "task.start": _listed(task.start), "task.end": _listed(task.end)}
    if not given["task.path"]:
        return []
    count = max(map(len, given.values()))
    for key, values in given.items():
        if len(values) not in (1, count):
            raise InputError(f"{key}: there are {len(values)}; expected one, or {count} as of the others")
    paths, starts, ends = (values * count if len(values) == 1 else values for values in given.values())
    return [
        Part(path, _position("task.start", start), _position("task.end", end), task.stride)
        for path, start, end in zip(paths, starts, ends, strict=True)
    ]


def _listed(value: Any) -> list[Any]:
    return list(value) if isinstance(value, list | tuple) else [value]


def _position(key: str, value: Any) -> Position | None:
    return None if value is None else Position.parse(key, value)
