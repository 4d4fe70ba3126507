"""Work that is done ahead: its order, its bounds, and how it ends."""

import threading
import time
from collections.abc import Iterator
from contextlib import closing
from itertools import count

import pytest

from geoskill.io.prefetch import parallel_map, prefetch_map

LIMIT_S = 10.0


class Source:
    """Counts what is taken from it, and whether it has been closed."""

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
    """Until it holds; the test fails when it does not within some seconds."""
    begun = time.monotonic()
    assert callable(condition)
    while not condition():
        assert time.monotonic() - begun < LIMIT_S
        time.sleep(0.001)


@pytest.mark.parametrize("threads", [1, 2, 5])
@pytest.mark.parametrize("length", [0, 1, 2, 30])
def test_results_come_in_the_order_of_the_items(threads: int, length: int) -> None:
    def later_is_quicker(number: int) -> int:
        time.sleep(0.002 * (number % 3 == 0))
        return 10 * number

    source, before = Source(length), threading.active_count()
    assert list(prefetch_map(later_is_quicker, source, threads=threads)) == [10 * number for number in range(length)]
    assert (source.taken, source.closed, threading.active_count()) == (length, True, before)


def test_one_thread_is_the_callers_and_does_nothing_ahead() -> None:
    source, workers = Source(), set()
    with closing(
        prefetch_map(lambda number: workers.add(threading.get_ident()), source, threads=1, ahead=7)
    ) as results:
        for used in range(4):
            next(results)
            assert source.taken == used + 1
    assert source.takers == workers == {threading.get_ident()}
    assert source.closed


def test_items_are_worked_on_at_once_by_as_many_threads_and_taken_by_one() -> None:
    together = threading.Barrier(3, timeout=LIMIT_S)  # breaks unless three come to it at the same time
    source = Source(9)
    assert list(prefetch_map(lambda number: together.wait() >= 0, source, threads=3)) == [True] * 9
    assert len(source.takers) == 1
    assert threading.get_ident() not in source.takers


def test_the_present_is_used_while_the_next_is_worked_on() -> None:
    working = threading.Event()

    def work(number: int) -> int:
        if number == 1:
            working.set()
        return number

    with closing(prefetch_map(work, Source(), threads=2, ahead=1)) as results:
        assert next(results) == 0
        assert working.wait(LIMIT_S)


@pytest.mark.parametrize(("threads", "ahead", "bound"), [(2, None, 2), (3, None, 3), (2, 1, 1), (2, 5, 5)])
def test_no_more_is_taken_ahead_than_was_said(threads: int, ahead: int | None, bound: int) -> None:
    source = Source()
    with closing(prefetch_map(lambda number: number, source, threads=threads, ahead=ahead)) as results:
        for used in range(6):
            assert next(results) == used
            wait_until(lambda used=used: source.taken == used + 1 + bound)
            time.sleep(0.005)  # whoever uses it is slow: time enough to go too far
            assert source.taken == used + 1 + bound


@pytest.mark.parametrize("threads", [1, 2, 4])
@pytest.mark.parametrize("failure", [ValueError("broken"), KeyboardInterrupt()])
def test_what_fails_while_an_item_is_taken_is_raised_in_its_place(threads: int, failure: BaseException) -> None:
    source, seen = Source(5, failure), []
    with pytest.raises(type(failure)) as raised:
        for result in prefetch_map(lambda number: number, source, threads=threads):
            seen.append(result)
    assert raised.value is failure
    assert seen == [0, 1, 2, 3, 4]
    assert source.closed


@pytest.mark.parametrize("threads", [1, 2, 4])
def test_what_fails_in_the_work_is_raised_in_its_place(threads: int) -> None:
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
def test_a_loop_that_is_left_early_ends_the_threads_and_the_source(threads: int) -> None:
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


def test_what_is_never_asked_for_is_never_begun() -> None:
    source, before = Source(), threading.active_count()
    prefetch_map(lambda number: number, source, threads=2).close()
    assert (source.taken, threading.active_count()) == (0, before)


@pytest.mark.parametrize(("threads", "ahead"), [(0, None), (2, 0)])
def test_numbers_below_one(threads: int, ahead: int | None) -> None:
    with pytest.raises(ValueError, match=r"expected at least 1"):
        next(prefetch_map(lambda number: number, [1], threads=threads, ahead=ahead))


@pytest.mark.parametrize("threads", [1, 3])
def test_all_of_it_with_progress(threads: int) -> None:
    told: list[tuple[list[int], str]] = []

    def progress(numbers: object, description: str) -> object:
        told.append((list(numbers), description))  # type: ignore[call-overload]
        return numbers

    results = parallel_map(str, Source(3), [4, 5, 6], threads=threads, progress=progress, description="counting")  # type: ignore[arg-type]
    assert results == ["0", "1", "2"]
    assert told == [([4, 5, 6], "counting")]
    with pytest.raises(ValueError, match="argument 2 is longer"):
        parallel_map(str, Source(3), [4, 5], threads=threads, progress=lambda numbers, text: numbers, description="")
