"""Prefetching: order of the results, bounds, errors and shutdown."""

import threading
import time
from collections.abc import Iterator
from contextlib import closing
from itertools import count

import pytest

from geoskill.io.prefetch import parallel_map, prefetch_map

LIMIT_S = 10.0


class Source:
    """Numbers that count how many were read, by which threads, and whether the generator was closed."""

    def __init__(self, length: int | None = None, failure: BaseException | None = None) -> None:
        self.length = length
        self.failure = failure
        self.taken = 0
        self.takers: set[int] = set()
        self.closed = False

    def __iter__(self) -> Iterator[int]:
        try:
            for number in count() if self.length is None else range(self.length):
                self.taken += 1
                self.takers.add(threading.get_ident())
                yield number
            if self.failure is not None:
                raise self.failure
        finally:
            self.closed = True


def wait_until(condition: object) -> None:
    """Wait until a condition holds; fail after some seconds."""
    start_s = time.monotonic()
    assert callable(condition)
    while not condition():
        assert time.monotonic() - start_s < LIMIT_S
        time.sleep(0.001)


@pytest.mark.parametrize("threads", [1, 2, 5])
@pytest.mark.parametrize("length", [0, 1, 2, 30])
def test_prefetch_map_keeps_the_order_of_the_items(threads: int, length: int) -> None:
    def slow_every_third(number: int) -> int:
        time.sleep(0.002 * (number % 3 == 0))
        return 10 * number

    source, before = Source(length), threading.active_count()
    assert list(prefetch_map(slow_every_third, source, threads=threads)) == [10 * number for number in range(length)]
    assert (source.taken, source.closed, threading.active_count()) == (length, True, before)


def test_prefetch_map_with_one_thread_runs_in_the_callers_thread_on_demand() -> None:
    source, workers = Source(), set()
    with closing(
        prefetch_map(lambda number: workers.add(threading.get_ident()), source, threads=1, max_prefetch=7)
    ) as results:
        for used in range(4):
            next(results)
            assert source.taken == used + 1
    assert source.takers == workers == {threading.get_ident()}
    assert source.closed


def test_prefetch_map_reads_in_one_thread_and_works_in_all() -> None:
    together = threading.Barrier(3, timeout=LIMIT_S)  # breaks unless three threads wait at the same time
    source = Source(9)
    assert list(prefetch_map(lambda number: together.wait() >= 0, source, threads=3)) == [True] * 9
    assert len(source.takers) == 1
    assert threading.get_ident() not in source.takers


def test_prefetch_map_works_on_the_next_item_while_one_is_in_use() -> None:
    working = threading.Event()

    def work(number: int) -> int:
        if number == 1:
            working.set()
        return number

    with closing(prefetch_map(work, Source(), threads=2, max_prefetch=1)) as results:
        assert next(results) == 0
        assert working.wait(LIMIT_S)


@pytest.mark.parametrize(("threads", "max_prefetch", "bound"), [(2, None, 2), (3, None, 3), (2, 1, 1), (2, 5, 5)])
def test_max_prefetch_bounds_the_items_read(threads: int, max_prefetch: int | None, bound: int) -> None:
    source = Source()
    with closing(prefetch_map(lambda number: number, source, threads=threads, max_prefetch=max_prefetch)) as results:
        for used in range(6):
            assert next(results) == used
            wait_until(lambda used=used: source.taken == used + 1 + bound)
            time.sleep(0.005)  # a slow consumer leaves the reader time to go too far
            assert source.taken == used + 1 + bound


@pytest.mark.parametrize("threads", [1, 2, 4])
@pytest.mark.parametrize("failure", [ValueError("broken"), KeyboardInterrupt()])
def test_prefetch_map_raises_a_read_error_in_place_of_the_item(threads: int, failure: BaseException) -> None:
    source, seen = Source(5, failure), []
    with pytest.raises(type(failure)) as raised:
        for result in prefetch_map(lambda number: number, source, threads=threads):
            seen.append(result)
    assert raised.value is failure
    assert seen == [0, 1, 2, 3, 4]
    assert source.closed


@pytest.mark.parametrize("threads", [1, 2, 4])
def test_prefetch_map_raises_a_work_error_in_place_of_the_result(threads: int) -> None:
    def work(number: int) -> float:
        return 1 / (3 - number)

    source, seen, before = Source(), [], threading.active_count()
    with pytest.raises(ZeroDivisionError):
        for result in prefetch_map(work, source, threads=threads):
            seen.append(result)
    assert len(seen) == 3
    assert source.taken <= 4 + threads
    assert (source.closed, threading.active_count()) == (True, before)


@pytest.mark.parametrize("threads", [1, 2, 4])
def test_prefetch_map_closed_early_ends_the_threads_and_the_source(threads: int) -> None:
    source, before = Source(), threading.active_count()
    with pytest.raises(RuntimeError), closing(prefetch_map(lambda number: number, source, threads=threads)) as results:
        for result in results:
            if result == 3:
                raise RuntimeError
    assert source.closed
    assert threading.active_count() == before
    taken = source.taken
    assert 4 <= taken <= 5 + threads
    time.sleep(0.01)
    assert source.taken == taken


def test_prefetch_map_starts_nothing_before_the_first_request() -> None:
    source, before = Source(), threading.active_count()
    prefetch_map(lambda number: number, source, threads=2).close()
    assert (source.taken, threading.active_count()) == (0, before)


@pytest.mark.parametrize(("threads", "max_prefetch"), [(0, None), (2, 0)])
def test_prefetch_map_refuses_numbers_below_one(threads: int, max_prefetch: int | None) -> None:
    with pytest.raises(ValueError, match=r"expected at least 1"):
        next(prefetch_map(lambda number: number, [1], threads=threads, max_prefetch=max_prefetch))


@pytest.mark.parametrize("threads", [1, 3])
def test_parallel_map_returns_all_results_and_shows_progress(threads: int) -> None:
    shown: list[tuple[list[int], str]] = []

    def progress(numbers: object, description: str) -> object:
        shown.append((list(numbers), description))  # type: ignore[call-overload]
        return numbers

    results = parallel_map(str, Source(3), [4, 5, 6], threads=threads, progress=progress, description="counting")  # type: ignore[arg-type]
    assert results == ["0", "1", "2"]
    assert shown == [([4, 5, 6], "counting")]
    with pytest.raises(ValueError, match="argument 2 is longer"):
        parallel_map(str, Source(3), [4, 5], threads=threads, progress=lambda numbers, text: numbers, description="")
