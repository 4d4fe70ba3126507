"""Parts of ten frames at uneven times."""

import numpy as np
import pytest

from geoskill.errors import InputError
from geoskill.io.arrays import ArrayFrames
from geoskill.io.segment import Position, Segment

TEN = ArrayFrames([np.full((2, 2, 3), number, np.uint8) for number in range(10)], frame_rate=10.0, name="ten")


def seconds(value: float) -> Position:
    return Position(value)


def frames(value: int) -> Position:
    return Position(value, in_frames=True)


@pytest.mark.parametrize(
    ("start", "end", "stride", "numbers"),
    [
        (None, None, 1, range(10)),
        (frames(3), None, 1, range(3, 10)),
        (frames(3), frames(7), 1, range(3, 7)),
        (frames(3), frames(8), 2, (3, 5, 7)),
        (seconds(0.3), seconds(0.7), 1, range(3, 7)),  # 3 / 10 is a little more than 0.3
        (seconds(0.25), frames(9), 3, (3, 6)),
        (None, seconds(99), 4, (0, 4, 8)),
    ],
)
def test_frames_of_a_part(
    start: Position | None, end: Position | None, stride: int, numbers: tuple[int, ...] | range
) -> None:
    part = Segment(TEN, start, end, stride)
    assert part.frame_rate == 10.0 / stride
    for _ in range(2):
        taken = list(part)
        assert [int(frame.image[0, 0, 0]) for frame in taken] == list(numbers)
        assert [frame.index for frame in taken] == list(range(len(numbers)))
        assert [frame.time_s for frame in taken] == pytest.approx([0.1 * stride * i for i in range(len(numbers))])


def test_name_says_what_part_it_is() -> None:
    assert Segment(TEN).name == "ten"
    assert Segment(TEN, seconds(2.5), frames(90), 3).name == "ten (from 2.5 s, to frame 90, every 3 frames)"


@pytest.mark.parametrize("value", [-1, "-1", "1m", "", "f", "1.5f", True, "nan", "1e3", [1]])
def test_what_is_no_position(value: object) -> None:
    with pytest.raises(InputError, match=r"^task\.start=.*: expected seconds, such as 2\.5, or frames, such as 75f$"):
        Position.parse("task.start", value)


def test_end_before_the_start() -> None:
    with pytest.raises(InputError, match=r"^ten: the end is 2 s; expected one after the start, 2 s$"):
        Segment(TEN, seconds(2), seconds(2))
    with pytest.raises(InputError, match=r"^stride=0: expected at least 1$"):
        Segment(TEN, stride=0)


@pytest.mark.parametrize(("start", "end"), [(seconds(3), None), (frames(10), None), (seconds(0.5), frames(2))])
def test_part_without_a_frame(start: Position, end: Position | None) -> None:
    last = "frame 2 at 0.20 s" if end else "frame 9 at 0.90 s"
    with pytest.raises(InputError, match=rf"^ten \(from .*\): there is no frame; expected some before.*{last}$"):
        list(Segment(TEN, start, end))
