"""What is said of times and memory."""

import pytest
import torch

from geoskill.benchmarks.measurement import Figures, peak_memory_mb, times_in_turn


def test_ways_are_timed_in_turn_after_a_round_that_does_not_count() -> None:
    order: list[str] = []
    times = times_in_turn({"a": lambda: order.append("a"), "b": lambda: order.append("b")}, repeats=3)
    assert order == ["a", "b"] * 4
    assert {name: len(seconds) for name, seconds in times.items()} == {"a": 3, "b": 3}
    assert all(seconds >= 0 for each in times.values() for seconds in each)


def test_the_median_is_not_moved_by_one_disturbance() -> None:
    assert Figures((0.1, 0.2, 9.0)).median_s == 0.2


def test_peak_memory_counts_what_is_held_at_once() -> None:
    there_before = torch.ones(1 << 20)

    def work() -> torch.Tensor:
        large = there_before.repeat(10)  # 40 MiB
        small = large[: 1 << 20] + 1  # 4 MiB
        del large
        return small + small  # 8 MiB

    assert peak_memory_mb(work) == pytest.approx(44, abs=0.5)


def test_work_without_tensors_holds_nothing() -> None:
    assert peak_memory_mb(lambda: None) == 0
