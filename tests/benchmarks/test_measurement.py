"""Timing in turns and peak memory."""

import pytest
import torch

from geoskill.benchmarks.measurement import peak_memory_mb, single_runs, time_in_turns


def test_workloads_are_timed_in_turns_after_an_untimed_round() -> None:
    order: list[str] = []
    timings = time_in_turns({"a": lambda: order.append("a"), "b": lambda: order.append("b")}, repeats=3)
    assert order == ["a", "b"] * 4
    assert {name: len(timing.times) for name, timing in timings.items()} == {"a": 3, "b": 3}
    assert {name: timing.label for name, timing in timings.items()} == {"a": "a", "b": "b"}
    assert all(seconds >= 0 for timing in timings.values() for seconds in timing.times)


def test_time_in_turns_times_the_workload_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    now = 0.0

    def work(seconds: float) -> None:
        nonlocal now
        now += seconds

    monkeypatch.setattr("geoskill.benchmarks.measurement.timer", lambda: now)
    timings = time_in_turns({"short": lambda: work(0.25), "long": lambda: work(2.0)}, repeats=2)
    assert {name: timing.times for name, timing in timings.items()} == {"short": [0.25] * 2, "long": [2.0] * 2}


def test_median_ignores_one_disturbance() -> None:
    assert single_runs([0.1, 0.2, 9.0]).median == 0.2


def test_peak_memory_counts_tensors_alive_at_once() -> None:
    existing = torch.ones(1 << 20)

    def work() -> torch.Tensor:
        large = existing.repeat(10)  # 40 MiB
        small = large[: 1 << 20] + 1  # 4 MiB
        del large
        return small + small  # 8 MiB

    assert peak_memory_mb(work) == pytest.approx(44, abs=0.5)


def test_peak_memory_without_tensors_is_zero() -> None:
    assert peak_memory_mb(lambda: None) == 0
