"""The newest frame of a source that goes on by itself."""

import threading
import time
from collections.abc import Iterator
from contextlib import closing
from typing import final

import numpy as np
import pytest

from geoskill.errors import InputError
from geoskill.io.frames import Frame, FrameSource
from geoskill.io.latest import latest_frames


@final
class Ticking(FrameSource):
    """Frames of a recording of 50 Hz, or of a camera that delivers one whenever it is told to."""

    def __init__(self, count: int, ready: "list[threading.Event] | None" = None, fails: bool = False) -> None:
        self._count, self._ready, self._fails = count, ready, fails
        self.closed = False

    @property
    def name(self) -> str:
        return "ticking"

    @property
    def frame_rate(self) -> float:
        return 50.0

    def __iter__(self) -> Iterator[Frame]:
        try:
            for index in range(self._count):
                if self._ready is not None:
                    assert self._ready[index].wait(5)
                yield Frame(index, index / 50, np.zeros((2, 2, 3), np.uint8))
            if self._fails:
                raise InputError("ticking: no picture after 3 frames")
        finally:
            self.closed = True


def test_recording_is_played_as_fast_as_it_was_recorded() -> None:
    began = time.time()
    taken = list(latest_frames(Ticking(10), real_time=True))
    assert 0.17 < time.time() - began < 2
    assert taken[-1].frame.index == 9
    numbers = [own.frame.index for own in taken]
    assert numbers == sorted(set(numbers))
    steps = np.diff([own.taken_at for own in taken])
    np.testing.assert_allclose(steps, 0.02 * np.diff(numbers), atol=1e-6)  # when it was due, not when it was given


def test_who_is_slow_gets_the_newest() -> None:
    ready = [threading.Event() for _ in range(6)]
    source = Ticking(6, ready)
    with closing(latest_frames(source, real_time=False)) as frames:
        ready[0].set()
        assert next(frames).frame.index == 0
        for event in ready[1:4]:
            event.set()
        time.sleep(0.1)
        assert next(frames).frame.index == 3
        ready[4].set()
        ready[5].set()
    assert source.closed


def test_end_and_failure_of_the_source() -> None:
    assert [own.frame.index for own in latest_frames(Ticking(0), real_time=False)] == []
    with pytest.raises(InputError, match="no picture after 3 frames"):
        list(latest_frames(Ticking(3, fails=True), real_time=True))
