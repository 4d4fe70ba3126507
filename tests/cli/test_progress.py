"""Progress: a bar on a terminal, lines elsewhere, of the first process alone."""

import threading
import time
from collections.abc import Iterable, Iterator
from typing import Any

import pytest
from lightning.fabric.utilities.rank_zero import rank_zero_only

from geoskill.cli import progress
from geoskill.cli.progress import ProgressLines, show_progress, show_stage


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """The time in its only entry."""
    now = [100.0]
    monkeypatch.setattr(time, "monotonic", lambda: now[0])
    monkeypatch.setattr(progress, "LINES", ProgressLines())
    return now


def working(clock: list[float], count: int, seconds: float) -> Iterator[int]:
    for number in range(count):
        yield number
        clock[0] += seconds


@pytest.mark.parametrize(("rank", "terminal", "shown"), [(0, True, True), (0, False, False), (1, True, False)])
def test_bar_of_the_first_process_on_a_terminal(
    monkeypatch: pytest.MonkeyPatch, rank: int, terminal: bool, shown: bool
) -> None:
    bars: list[dict[str, Any]] = []

    def track(items: Iterable[int], **given: Any) -> Iterable[int]:
        bars.append(given)
        return items

    monkeypatch.setattr("geoskill.cli.progress.track", track)
    monkeypatch.setattr("sys.stdout.isatty", lambda: terminal)
    monkeypatch.setattr(rank_zero_only, "rank", rank)
    assert list(show_progress(range(3), "counting")) == [0, 1, 2]
    assert len(bars) == shown


def test_lines_without_a_terminal(clock: list[float], capsys: pytest.CaptureFixture[str]) -> None:
    """Ten items of four seconds: a line every fifteen."""
    assert list(show_progress(working(clock, 10, 4.0), "counting", total=10)) == list(range(10))
    assert capsys.readouterr().out.splitlines() == [
        "counting: 10",
        "counting: 4 of 10, 24 s left",
        "counting: 8 of 10, 8 s left",
    ]
    show_stage("writing")
    list(show_progress(working(clock, 5, 20.0), "watching"))
    expected = ["writing", "watching", *(f"watching: {done}" for done in range(1, 5))]
    assert capsys.readouterr().out.splitlines() == expected


def test_other_processes_are_silent(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setattr(rank_zero_only, "rank", 1)
    assert list(show_progress(range(3), "counting")) == [0, 1, 2]
    show_stage("writing")
    assert capsys.readouterr().out == ""


def test_progress_without_lightning(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delitem(__import__("sys").modules, "lightning.fabric.utilities.rank_zero")
    assert list(show_progress(range(3), "counting")) == [0, 1, 2]


def test_long_silence_is_broken(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setattr(progress, "SILENCE_S", 0.05)
    lines, ended = ProgressLines(), threading.Event()
    lines.enter("fitting: epoch 1 of 16")
    thread = threading.Thread(target=lines.keep_alive, args=(ended,))
    thread.start()
    time.sleep(0.35)
    ended.set()
    thread.join(timeout=10)
    said = capsys.readouterr().out.splitlines()
    assert said[0] == "fitting: epoch 1 of 16"
    assert 1 <= said.count("fitting: still at work after 1 s") <= 7
