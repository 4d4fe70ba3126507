"""Frames that are needed more than once: kept in memory where they fit, read again where they do not."""

from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from typing import TypeVar, final, overload

import numpy as np

from geoskill.errors import InputError
from geoskill.geometry.depth_picture import DepthPicture
from geoskill.io.frames import Frame, FrameSource

# Ten seconds of VGA take 280 MB, one second of 4K takes 750 MB.
KEPT_MB = 512.0


@final
class KeptFrames(FrameSource, Sequence[Frame]):
    """All frames of a source that comes to an end, by their numbers.

    Making it reads the source once. Where the pictures, with their depth, take more than ``memory_mb``, only the first
    and the last are kept, and the others are read again when they are asked for, up to the one that is wanted: iterate,
    or ask in ascending order. Not for several threads at once.

    Args:
        source: what is read.
        minimum: how many frames it needs.
        memory_mb: megabytes that pictures may take; None for :data:`KEPT_MB`.

    Raises:
        InputError: when there are fewer than ``minimum``, or one cannot be read.
    """

    def __init__(self, source: FrameSource, minimum: int = 1, memory_mb: float | None = None) -> None:
        memory_mb = KEPT_MB if memory_mb is None else memory_mb
        self._source = source
        self._kept: list[Frame] = []
        self._are_all_kept = True
        self._count, size = 0, 0
        for frame in source:
            self._count += 1
            size += frame.nbytes
            self._kept.append(frame)
            if size > 1e6 * memory_mb:
                self._are_all_kept = False
                self._kept = [self._kept[0], frame]
        if self._count < minimum:
            raise InputError(f"{source.name}: {self._count} frame(s); expected at least {minimum}")
        self._reader: Iterator[Frame] = iter(())
        self._read: Frame | None = None

    @property
    def name(self) -> str:
        """See :attr:`FrameSource.name`."""
        return self._source.name

    @property
    def frame_rate(self) -> float:
        """See :attr:`FrameSource.frame_rate`."""
        return self._source.frame_rate

    def __len__(self) -> int:
        return self._count

    def __iter__(self) -> Iterator[Frame]:
        return iter(self._kept if self._are_all_kept else self._source)

    @overload
    def __getitem__(self, index: int) -> Frame: ...

    @overload
    def __getitem__(self, index: slice) -> list[Frame]: ...

    def __getitem__(self, index: int | slice) -> Frame | list[Frame]:
        if isinstance(index, slice):
            return [self[number] for number in range(*index.indices(self._count))]
        number = range(self._count)[index]
        if self._are_all_kept:
            return self._kept[number]
        if number in (0, self._count - 1):
            return self._kept[0 if number == 0 else 1]
        if self._read is None or self._read.index > number:
            self._reader, self._read = iter(self._source), None
        while self._read is None or self._read.index < number:
            self._read = next(self._reader)
        return self._read


Part = TypeVar("Part")


class _Parts(Sequence[Part], ABC):
    """One part of each frame of a recording, as it is asked for.

    Args:
        frames: of one recording.
    """

    def __init__(self, frames: Sequence[Frame]) -> None:
        self._frames = frames

    @staticmethod
    @abstractmethod
    def _of(frame: Frame) -> Part:
        """Return the part of a frame."""

    def __len__(self) -> int:
        return len(self._frames)

    def __iter__(self) -> Iterator[Part]:
        return map(self._of, self._frames)

    @overload
    def __getitem__(self, index: int) -> Part: ...

    @overload
    def __getitem__(self, index: slice) -> list[Part]: ...

    def __getitem__(self, index: int | slice) -> Part | list[Part]:
        if isinstance(index, slice):
            return [self._of(frame) for frame in self._frames[index]]
        return self._of(self._frames[index])


@final
class Pictures(_Parts[np.ndarray]):
    """The RGB pictures ``[H, W, 3]`` of frames."""

    @staticmethod
    def _of(frame: Frame) -> np.ndarray:
        return frame.image


@final
class Depths(_Parts[DepthPicture]):
    """The depth of frames, all of which have it."""

    @staticmethod
    def _of(frame: Frame) -> DepthPicture:
        if frame.depth is None:
            raise InputError(f"frame {frame.index} has no depth; expected depth in every frame, as in the first")
        return frame.depth
