"""The optical flow between the frames of a demonstration that are some frames apart.

A flow takes 16 bytes for each pixel of the working size, so the flows of a long demonstration fit into no memory. Those
are computed whenever they are asked for, from small gray pictures in a temporary file, and only recent ones are kept.
"""

import tempfile
import weakref
from collections import OrderedDict, deque
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import final, overload

import cv2
import numpy as np
from jaxtyping import UInt8

from geoskill.geometry.sampling import resized
from geoskill.io.prefetch import Progress, parallel_map
from geoskill.tracking.flow import WORKING_SIDE, Flow, gray_flow

# Memory in which all flows of a demonstration are kept: of VGA, those of seven seconds.
KEPT_MB = 1024.0
# Small pictures that take no more than this stay in memory, too.
MAX_SPOOLED_BYTES = 64_000_000

# At the working size.
Gray = UInt8[np.ndarray, "h w"]


def neighbor_flows(
    frames: Sequence[np.ndarray],
    hop: int,
    progress: Progress,
    threads: int = 1,
    *,
    recent: int = 64,
    memory_mb: float | None = None,
) -> Sequence[Flow]:
    """Compute the flow from every frame ``t`` to frame ``t + hop``.

    Args:
        frames: ``[H, W, 3]`` RGB pictures.
        hop: number of frames from the first to the second frame of a flow.
        progress: shows progress over the frames.
        threads: number of flows computed at once.
        recent: how far back flows are asked for again; of a long demonstration, so many are kept.
        memory_mb: megabytes that flows may take, unless ``recent`` of them take more; None for :data:`KEPT_MB`.
    """
    memory_mb = KEPT_MB if memory_mb is None else memory_mb
    starts = range(len(frames) - hop)
    scale = min(1.0, WORKING_SIDE / min(frames[0].shape[:2]))
    flow_bytes = 16 * _small_gray(frames[0], scale).size
    smalls = (_small_gray(frame, scale) for frame in frames)
    if len(starts) * flow_bytes <= 1e6 * memory_mb:

        def flow(pair: tuple[Gray, Gray]) -> Flow:
            return replace(gray_flow(*pair), scale=scale)

        pairs = _pairs(smalls, hop)
        return parallel_map(flow, pairs, starts, threads=threads, progress=progress, description="following motion")
    pictures = _PictureFile()
    for _, small in zip(progress(range(len(frames)), "following motion"), smalls, strict=True):
        pictures.append(small)
    return _RecentFlows(pictures, hop, scale, max(recent + hop + 1, int(1e6 * memory_mb) // flow_bytes // 2))


def _small_gray(frame: UInt8[np.ndarray, "height width 3"], scale: float) -> Gray:
    return resized(np.asarray(cv2.cvtColor(frame, cv2.COLOR_RGB2GRAY), np.uint8), scale)


def _pairs(pictures: Iterator[Gray], hop: int) -> Iterator[tuple[Gray, Gray]]:
    window: deque[Gray] = deque(maxlen=hop + 1)
    for picture in pictures:
        window.append(picture)
        if len(window) == hop + 1:
            yield window[0], picture


@final
class _PictureFile:
    """Pictures of one size in a temporary file, which goes with the object."""

    def __init__(self) -> None:
        self._file = tempfile.SpooledTemporaryFile(MAX_SPOOLED_BYTES)  # noqa: SIM115
        weakref.finalize(self, self._file.close)
        self._shape: tuple[int, ...] = ()
        self._count = 0

    def __len__(self) -> int:
        return self._count

    def append(self, picture: Gray) -> None:
        """Write a picture behind the others."""
        self._shape = picture.shape
        self._file.write(np.ascontiguousarray(picture).data)
        self._count += 1

    def read(self, number: int) -> Gray:
        """Read a picture."""
        size = int(np.prod(self._shape))
        self._file.seek(number * size)
        return np.frombuffer(self._file.read(size), np.uint8).reshape(self._shape)


@final
class _RecentFlows(Sequence[Flow]):
    """Flows that are computed when they are asked for.

    Args:
        pictures: small gray ones.
        hop: number of frames from the first to the second frame of a flow.
        scale: size of these pictures divided by that of the frames.
        kept: how many flows are kept, those that were asked for last.
    """

    def __init__(self, pictures: _PictureFile, hop: int, scale: float, kept: int) -> None:
        self._pictures, self._hop, self._scale, self._kept = pictures, hop, scale, kept
        self._recent: OrderedDict[int, Flow] = OrderedDict()

    def __len__(self) -> int:
        return len(self._pictures) - self._hop

    @overload
    def __getitem__(self, index: int) -> Flow: ...

    @overload
    def __getitem__(self, index: slice) -> list[Flow]: ...

    def __getitem__(self, index: int | slice) -> Flow | list[Flow]:
        if isinstance(index, slice):
            return [self[number] for number in range(*index.indices(len(self)))]
        start = range(len(self))[index]
        if start not in self._recent:
            if len(self._recent) == self._kept:
                self._recent.popitem(last=False)
            pair = self._pictures.read(start), self._pictures.read(start + self._hop)
            self._recent[start] = replace(gray_flow(*pair), scale=self._scale)
        self._recent.move_to_end(start)
        return self._recent[start]
