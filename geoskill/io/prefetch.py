"""Work on the frames to come while the present one is being used.

::

    read    0  1  2  3  4  .  .          one thread takes the items, one after the other
    work       0     2                   others work, each on an item of its own
                  1     3
    use              0  1  2  3          whoever iterates gets the results in the order of the items

Threads suffice: decoders, OpenCV and PyTorch let go of Python's lock while they compute. OpenCV's own threads, inside
one frame, gain little beside it: measured on two cores, SIFT of two frames at once takes less than half of the time of
one after the other, whatever OpenCV does.
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


class _After(Enum):
    """What comes after the last item."""

    LAST = auto()


def prefetch_map(
    work: Callable[[Item], Result], items: Iterable[Item], *, threads: int, ahead: int | None = None
) -> Generator[Result, None, None]:
    """The result of ``work`` for every item, in the order of the items.

    What is raised while an item is taken or worked on, ``KeyboardInterrupt`` included, is raised in the place of its
    result, and is the end. Closing the generator (:func:`contextlib.closing`, for a loop that is left early) waits for
    what is being worked on, begins nothing more and closes the items' own generator, so that a camera is released.

    Args:
        work: is called from several threads at once.
        items: taken by one thread, one after the other; may be endless.
        threads: how many items are worked on at once. With one, all is done in the caller's thread, when asked for.
        ahead: how many items, at most, are taken beyond the one whose result is in use; they wait where whoever
            iterates is slower than work. None for as many as ``threads``, which keeps all of them busy.

    Raises:
        ValueError: when ``threads`` or ``ahead`` is below 1.

    >>> list(prefetch_map(lambda number: number**2, range(5), threads=2))
    [0, 1, 4, 9, 16]
    """
    ahead = threads if ahead is None else ahead
    if min(threads, ahead) < 1:
        raise ValueError(f"threads={threads}, ahead={ahead}: expected at least 1")
    iterator = iter(items)
    try:
        yield from map(work, iterator) if threads == 1 else _overlapped(work, iterator, threads, ahead)
    finally:
        if isinstance(iterator, Generator):
            iterator.close()


def _overlapped(
    work: Callable[[Item], Result], items: Iterator[Item], threads: int, ahead: int
) -> Generator[Result, None, None]:
    reader, workers = ThreadPoolExecutor(1, "read ahead"), ThreadPoolExecutor(threads, "work ahead")

    def finish(reading: Future[Item | _After]) -> Result | _After:
        item = reading.result()
        return item if isinstance(item, _After) else work(item)

    def begin() -> Future[Result | _After]:
        return workers.submit(finish, reader.submit(next, items, _After.LAST))

    begun: deque[Future[Result | _After]] = deque()
    try:
        while True:
            while len(begun) <= ahead:
                begun.append(begin())
            result = begun.popleft().result()
            if isinstance(result, _After):
                return
            yield result
    finally:
        # The reader first: whoever waits for what it will not read any more goes on, and ends.
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
    """The results of :func:`prefetch_map`, with progress.

    Args:
        work: as there.
        items: as there; as many as there are ``numbers``.
        numbers: what progress is shown over.
        threads: as there.
        progress: shows progress over a sequence.
        description: what is being done.
    """
    with closing(prefetch_map(work, items, threads=threads)) as results:
        return [result for _, result in zip(progress(numbers, description), results, strict=True)]
