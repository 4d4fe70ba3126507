"""Frames that are in memory already."""

from collections.abc import Iterator, Sequence
from typing import final

import numpy as np
from jaxtyping import UInt8

from geoskill.errors import InputError
from geoskill.io.frames import DEFAULT_FRAME_RATE, Frame, FrameSource, validate_frame_rate


@final
class ArrayFrames(FrameSource):
    """The pictures of an array ``[T, H, W, 3]`` or of a sequence of arrays ``[H, W, 3]``, uint8, RGB.

    Args:
        pictures: in order of time.
        frame_rate: frames per second.
        name: what they are called in messages.

    Raises:
        InputError: when there is no picture, one is no RGB picture, or their sizes differ.
    """

    def __init__(
        self,
        pictures: Sequence[UInt8[np.ndarray, "height width 3"]] | UInt8[np.ndarray, "t height width 3"],
        frame_rate: float = DEFAULT_FRAME_RATE,
        name: str = "frames in memory",
    ) -> None:
        if len(pictures) == 0:
            raise InputError(f"{name}: no picture; expected a demonstration")
        first = list(getattr(pictures[0], "shape", ()))
        for number, picture in enumerate(pictures):
            shape = list(getattr(picture, "shape", ()))
            dtype = getattr(picture, "dtype", type(picture).__name__)
            if len(shape) != 3 or shape[2] != 3 or dtype != np.uint8 or 0 in shape:
                raise InputError(f"{name}: picture {number} is {dtype} {shape}; expected uint8 [height, width, 3], RGB")
            if shape != first:
                raise InputError(f"{name}: picture {number} is {shape}; expected that of the first, {first}")
        self._pictures = pictures
        self._frame_rate = validate_frame_rate(frame_rate)
        self._name = name

    @property
    def name(self) -> str:
        """See :attr:`FrameSource.name`."""
        return self._name

    @property
    def frame_rate(self) -> float:
        """See :attr:`FrameSource.frame_rate`."""
        return self._frame_rate

    def __len__(self) -> int:
        return len(self._pictures)

    def __iter__(self) -> Iterator[Frame]:
        for index, picture in enumerate(self._pictures):
            yield Frame(index, index / self._frame_rate, picture)


@final
class FramesInMemory(FrameSource):
    """Frames that have been read, with their depth if they have any.

    Args:
        frames: in order of time.
        frame_rate: frames per second.
        name: what they are called in messages.
    """

    def __init__(self, frames: Sequence[Frame], frame_rate: float, name: str) -> None:
        self._frames = frames
        self._frame_rate = validate_frame_rate(frame_rate)
        self._name = name

    @property
    def name(self) -> str:
        """See :attr:`FrameSource.name`."""
        return self._name

    @property
    def frame_rate(self) -> float:
        """See :attr:`FrameSource.frame_rate`."""
        return self._frame_rate

    def __iter__(self) -> Iterator[Frame]:
        return iter(self._frames)
