"""A part of a recording: from one point in time to another, or every so many frames."""

import re
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import final

from geoskill.errors import InputError
from geoskill.io.frames import Frame, FrameSource

# Time stamps are rounded, in some files to milliseconds.
TOLERANCE_S = 5e-4


@final
@dataclass(frozen=True)
class Position:
    """A place in a recording.

    Attributes:
        value: seconds after the first frame, or the number of a frame.
        in_frames: which of the two.
    """

    value: float
    in_frames: bool = False

    @classmethod
    def parse(cls, key: str, value: object) -> "Position":
        """Read a position: a number of seconds, ``2.5s`` or, in frames, ``75f``.

        Args:
            key: what it is called in messages.
            value: as the user gives it.

        Raises:
            InputError: when it is none of these.

        >>> [str(Position.parse("start", value)) for value in (2, "2.5s", "75f")]
        ['2 s', '2.5 s', 'frame 75']
        """
        match = re.fullmatch(r"([0-9]+|[0-9]*\.[0-9]+)s?|([0-9]+)f", str(value))
        if match is None or isinstance(value, bool):
            raise InputError(f"{key}={value}: expected seconds, such as 2.5, or frames, such as 75f")
        return cls(float(match[1] or match[2]), match[2] is not None)

    def __str__(self) -> str:
        return f"frame {self.value:g}" if self.in_frames else f"{self.value:g} s"

    def is_reached(self, frame: Frame) -> bool:
        """Return whether a frame of the recording is at this position or after it."""
        return frame.index >= self.value if self.in_frames else frame.time_s >= self.value - TOLERANCE_S


@final
class Segment(FrameSource):
    """The frames of a recording from ``start`` on and before ``end``, numbered and timed from the first of them.

    Args:
        source: the recording.
        start: first frame; None for that of the recording.
        end: frame that does not belong to it any more; None for the end of the recording.
        stride: of so many frames, one is taken.

    Raises:
        InputError: when ``stride`` is below 1, or ``end`` is not after ``start``.
    """

    def __init__(
        self, source: FrameSource, start: Position | None = None, end: Position | None = None, stride: int = 1
    ) -> None:
        if stride < 1:
            raise InputError(f"stride={stride}: expected at least 1")
        if start is not None and end is not None and start.in_frames == end.in_frames and not start.value < end.value:
            raise InputError(f"{source.name}: the end is {end}; expected one after the start, {start}")
        self._source = source
        self._start, self._end, self._stride = start or Position(0.0), end, stride
        self._part = [
            *([f"from {start}"] if start is not None else []),
            *([f"to {end}"] if end is not None else []),
            *([f"every {stride} frames"] if stride > 1 else []),
        ]

    @property
    def name(self) -> str:
        """Return the name of the recording and what part of it this is."""
        return f"{self._source.name} ({', '.join(self._part)})" if self._part else self._source.name

    @property
    def frame_rate(self) -> float:
        """Return the nominal frames per second that are taken."""
        return self._source.frame_rate / self._stride

    def __iter__(self) -> Iterator[Frame]:
        first: Frame | None = None
        last: Frame | None = None
        index = 0
        for frame in self._source:
            last = frame
            if self._end is not None and self._end.is_reached(frame):
                break
            if not self._start.is_reached(frame):
                continue
            first = first or frame
            if (frame.index - first.index) % self._stride == 0:
                yield replace(frame, index=index, time_s=frame.time_s - first.time_s)
                index += 1
        if first is None and last is not None:
            raise InputError(
                f"{self.name}: there is no frame; expected some before the last one, frame {last.index} at"
                f" {last.time_s:.2f} s"
            )
