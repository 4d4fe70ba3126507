"""Frames from memory: arrays and sequences of arrays."""

import re

import numpy as np
import pytest

from geoskill.errors import InputError
from geoskill.io.arrays import ArrayFrames

PICTURES = np.arange(3 * 4 * 5 * 3, dtype=np.uint8).reshape(3, 4, 5, 3)


@pytest.mark.parametrize("pictures", [PICTURES, list(PICTURES), tuple(PICTURES)])
def test_frames_are_the_pictures_in_order(pictures: object) -> None:
    source = ArrayFrames(pictures, frame_rate=4.0)  # type: ignore[arg-type]
    assert len(source) == 3
    for _ in range(2):  # from the first one each time
        frames = list(source)
        assert [(frame.index, frame.time_s) for frame in frames] == [(0, 0.0), (1, 0.25), (2, 0.5)]
        assert all(np.array_equal(frame.image, picture) for frame, picture in zip(frames, PICTURES, strict=True))


def test_name_and_frame_rate() -> None:
    assert (ArrayFrames(PICTURES).name, ArrayFrames(PICTURES).frame_rate) == ("frames in memory", 30.0)
    source = ArrayFrames(PICTURES, 12.5, "the recording")
    assert (source.name, source.frame_rate) == ("the recording", 12.5)


@pytest.mark.usefixtures("annotations_unchecked")
@pytest.mark.parametrize(
    ("pictures", "message"),
    [
        ([], "no picture; expected a demonstration"),
        (PICTURES[:0], "no picture; expected a demonstration"),
        (PICTURES[0], "picture 0 is uint8 [5, 3]; expected uint8 [height, width, 3], RGB"),
        (PICTURES[..., 0], "picture 0 is uint8 [4, 5]; expected uint8 [height, width, 3], RGB"),
        (PICTURES[..., :2], "picture 0 is uint8 [4, 5, 2]; expected uint8 [height, width, 3], RGB"),
        (PICTURES[:, :0], "picture 0 is uint8 [0, 5, 3]; expected uint8 [height, width, 3], RGB"),
        (PICTURES.astype(np.float32), "picture 0 is float32 [4, 5, 3]; expected uint8 [height, width, 3], RGB"),
        (PICTURES.astype(np.int8), "picture 0 is int8 [4, 5, 3]; expected uint8 [height, width, 3], RGB"),
        ([PICTURES[0], None], "picture 1 is NoneType []; expected uint8 [height, width, 3], RGB"),
        ([PICTURES[0], "a.png"], "picture 1 is str []; expected uint8 [height, width, 3], RGB"),
        ([[[1, 2], [3]]], "picture 0 is list []; expected uint8 [height, width, 3], RGB"),
        ([*PICTURES, PICTURES[0, 1:]], "picture 3 is [3, 5, 3]; expected that of the first, [4, 5, 3]"),
    ],
)
def test_other_pictures_are_refused(pictures: object, message: str) -> None:
    with pytest.raises(InputError, match=f"^clip: {re.escape(message)}$"):
        ArrayFrames(pictures, name="clip")  # type: ignore[arg-type]


@pytest.mark.parametrize("frame_rate", [0.0, -1.0, float("nan"), float("inf")])
def test_wrong_frame_rates_are_refused(frame_rate: float) -> None:
    with pytest.raises(InputError, match=r"^frame_rate is .*; expected frames per second from 0\.01 to 10000$"):
        ArrayFrames(PICTURES, frame_rate)
