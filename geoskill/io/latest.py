"""The newest frame of a source that goes on by itself: who is slow gets fewer frames, never old ones."""

import threading
import time
from collections.abc import Generator, Iterator
from dataclasses import dataclass
from typing import Final, final

from geoskill.io.frames import Frame, FrameSource

CLOSING_S: Final = 5.0
"""How long a source may take to give its next frame when it is to end."""


@final
@dataclass(frozen=True, eq=False)
class Taken:
    """A frame and when it was taken.

    Attributes:
        frame: the frame.
        taken_at: seconds since 1970.
    """

    frame: Frame
    taken_at: float


@final
class _Slot:
    """What one thread puts the newest frame into, and another takes it out of."""

    def __init__(self) -> None:
        self.closed = threading.Event()
        self._changed = threading.Condition()
        self._newest: Taken | None = None
        self._ended = False
        self._failure: BaseException | None = None

    def put(self, taken: Taken) -> None:
        with self._changed:
            self._newest = taken
            self._changed.notify()

    def end(self, failure: BaseException | None) -> None:
        with self._changed:
            self._ended, self._failure = True, failure
            self._changed.notify()

    def take(self) -> Taken | None:
        """Wait for a frame that was not taken yet; None after the last."""
        with self._changed:
            self._changed.wait_for(lambda: self._newest is not None or self._ended)
            taken, self._newest = self._newest, None
            if taken is None and self._failure is not None:
                raise self._failure
            return taken


def latest_frames(source: FrameSource, *, real_time: bool) -> Generator[Taken, None, None]:
    """Yield the newest frame whenever one is asked for; those in between are left out.

    Args:
        source: read in a thread of its own, which ends with the generator.
        real_time: whether a recording is played as fast as it was recorded; not for cameras, which take their time.

    Raises:
        InputError: what the source raises.
    """
    slot = _Slot()

    def read() -> None:
        frames: Iterator[Frame] = iter(source)
        failure: BaseException | None = None
        try:
            for taken in _played(frames, slot.closed) if real_time else _now(frames):
                slot.put(taken)
                if slot.closed.is_set():
                    break
        except BaseException as error:
            failure = error
        if isinstance(frames, Generator):
            frames.close()  # here, so that a camera is released by the thread that opened it
        slot.end(failure)

    reader = threading.Thread(target=read, name="latest frame", daemon=True)
    reader.start()
    try:
        while (taken := slot.take()) is not None:
            yield taken
    finally:
        slot.closed.set()
        reader.join(CLOSING_S)


def _now(frames: Iterator[Frame]) -> Iterator[Taken]:
    for frame in frames:
        yield Taken(frame, time.time())


def _played(frames: Iterator[Frame], closed: threading.Event) -> Iterator[Taken]:
    """Yield frames at the times at which they were recorded."""
    begun: float | None = None
    for frame in frames:
        begun = time.time() - frame.time_s if begun is None else begun
        due = begun + frame.time_s
        closed.wait(max(0.0, due - time.time()))
        yield Taken(frame, due)
