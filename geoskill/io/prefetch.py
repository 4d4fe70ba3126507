"""Prefetching: process the next frames in threads while the present one is being used.

::

    read    0  1  2  3  4  .  .          one thread reads the items, one after the other
    work       0     2                   worker threads process one item each
                  1     3
    use              0  1  2  3          the consumer gets the results in the order of the items

Threads suffice, because decoders, OpenCV and PyTorch release the global interpreter lock while they compute. Frames in
parallel gain more than OpenCV's own threads within one frame (docs/experiments/speed.md).
"""

from collections import deque
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import closing
from enum import Enum, auto
from typing import TypeVar

Item = TypeVar("Item")
Result = TypeVar("Result")
Progress = Callable[[Sequence[int], str], Iterable[int]]


class _End(Enum):
    """Marker that follows the last item."""

    OF_ITEMS = auto()


def prefetch_map(
    work: Callable[[Item], Result], items: Iterable[Item], *, threads: int, max_prefetch: int | None = None
) -> Generator[Result, None, None]:
    """Yield the result of ``work`` for every item, in the order of the items.

    An exception in reading or processing an item (``KeyboardInterrupt`` included) is raised in place of its result and
    ends the iteration. Closing the generator (by :func:`contextlib.closing`, if a loop may be left early) waits for
    running work, starts nothing more, and closes the generator behind ``items``, so that a camera is released.

    Args:
        work: called from several threads at once.
        items: read by a single thread, one after the other; may be endless.
        threads: number of items processed at once. With 1, everything happens in the caller's thread, on demand.
        max_prefetch: most items read beyond the one whose result is in use; they wait if the consumer is slower than
            ``work``. None for ``threads``, which keeps all threads busy.

    Raises:
        ValueError: when ``threads`` or ``max_prefetch`` is below 1.

    >>> list(prefetch_map(lambda number: number**2, range(5), threads=2))
    [0, 1, 4, 9, 16]
    """
    max_prefetch = threads if max_prefetch is None else max_prefetch
    if min(threads, max_prefetch) < 1:
        raise ValueError(f"threads={threads}, max_prefetch={max_prefetch}: expected at least 1")
    iterator = iter(items)
    try:
        yield from map(work, iterator) if threads == 1 else _overlapped(work, iterator, threads, max_prefetch)
    finally:
        if isinstance(iterator, Generator):
            iterator.close()


def _overlapped(
    work: Callable[[Item], Result], items: Iterator[Item], threads: int, max_prefetch: int
) -> Generator[Result, None, None]:
    reader, workers = ThreadPoolExecutor(1, "prefetch read"), ThreadPoolExecutor(threads, "prefetch work")

    def process(reading: Future[Item | _End]) -> Result | _End:
        item = reading.result()
        return item if isinstance(item, _End) else work(item)

    def submit() -> Future[Result | _End]:
        return workers.submit(process, reader.submit(next, items, _End.OF_ITEMS))

    pending: deque[Future[Result | _End]] = deque()
    try:
        while True:
            while len(pending) <= max_prefetch:
                pending.append(submit())
            result = pending.popleft().result()
            if isinstance(result, _End):
                return
            yield result
    finally:
        # The reader first: a worker that waits for a canceled read then ends.
        for pool in (reader, workers):
            pool.shutdown(cancel_futures=True)


def parallel_map(
    work: Callable[[Item], Result],
    items: Iterable[Item],
    numbers: Sequence[int],
    *,
    threads: int,
    progress: Progress,
    description: str,
) -> list[Result]:
    """Return the results of :func:`prefetch_map` as a list, and show progress.

    Args:
        work: called from several threads at once.
        items: read by a single thread; one for each of ``numbers``.
        numbers: the sequence over which progress is shown, such as frame numbers.
        threads: number of items processed at once.
        progress: wraps a sequence and shows the progress of iterating over it.
        description: what is being done, for the progress display.

    Raises:
        ValueError: when ``threads`` is below 1, or ``items`` and ``numbers`` differ in length.
    """
    with closing(prefetch_map(work, items, threads=threads)) as results:
        return [result for _, result in zip(progress(numbers, description), results, strict=True)]
