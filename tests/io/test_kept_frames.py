"""Frames that are kept, and frames that are read again."""

from collections.abc import Iterator

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from geoskill.errors import InputError
from geoskill.io.frames import Frame, FrameSource
from geoskill.io.kept_frames import KeptFrames, Pictures
from geoskill.io.sources import read_all

COUNT = 7
MEGABYTES = 10 * 10 * 3 / 1e6  # of one picture


class Counting(FrameSource):
    """Seven pictures, each of its number, and how often one was read."""

    def __init__(self) -> None:
        self.read = 0

    @property
    def name(self) -> str:
        return "seven"

    @property
    def frame_rate(self) -> float:
        return 10.0

    def __iter__(self) -> Iterator[Frame]:
        for number in range(COUNT):
            self.read += 1
            yield Frame(number, number / 10, np.full((10, 10, 3), number, np.uint8))


def number_of(frame: Frame) -> int:
    assert frame.image.min() == frame.image.max() == frame.index
    return frame.index


@pytest.mark.parametrize(("room", "times_read"), [(COUNT, 1), (COUNT - 1, 2), (0, 2)])
def test_frames_that_do_not_fit_are_read_again(room: int, times_read: int) -> None:
    source = Counting()
    frames = KeptFrames(source, memory_mb=room * MEGABYTES)
    assert (len(frames), frames.name, frames.frame_rate) == (COUNT, "seven", 10.0)
    assert [number_of(frame) for frame in frames] == list(range(COUNT))
    assert source.read == times_read * COUNT


@given(
    st.lists(st.integers(-COUNT, COUNT - 1), max_size=8),
    st.sampled_from([0.0, 2.5 * MEGABYTES, 100.0]),
)
def test_any_order_gives_the_right_frame(numbers: list[int], memory_mb: float) -> None:
    frames = KeptFrames(Counting(), memory_mb=memory_mb)
    assert [number_of(frames[number]) for number in numbers] == [number % COUNT for number in numbers]
    pictures = Pictures(frames)
    assert [int(pictures[number][0, 0, 0]) for number in numbers] == [number % COUNT for number in numbers]
    assert [int(picture[0, 0, 0]) for picture in pictures] == list(range(COUNT))


def test_ascending_order_reads_once_and_the_ends_are_kept() -> None:
    source = Counting()
    frames = KeptFrames(source, memory_mb=0.0)
    assert [number_of(frames[number]) for number in (0, -1, 6)] == [0, 6, 6]
    assert source.read == COUNT
    assert [number_of(frame) for frame in frames[1:6:2]] == [1, 3, 5]
    assert source.read == COUNT + 6
    assert [int(picture[0, 0, 0]) for picture in Pictures(frames)[5:]] == [5, 6]


def test_no_such_frame() -> None:
    with pytest.raises(IndexError):
        KeptFrames(Counting())[COUNT]


def test_too_few_frames() -> None:
    with pytest.raises(InputError, match=r"^seven: 7 frame\(s\); expected at least 8$"):
        KeptFrames(Counting(), minimum=8)


def test_what_was_read_is_not_read_again() -> None:
    source = Counting()
    frames = read_all(source)
    assert read_all(frames) is frames
    assert source.read == COUNT
    with pytest.raises(InputError, match=r"^seven: 7 frame\(s\); expected at least 8$"):
        read_all(frames, minimum=8)
