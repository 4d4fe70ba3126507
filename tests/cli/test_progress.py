"""Progress bars: on a terminal, of the first process alone."""

import sys
from typing import Any

import pytest
from lightning.fabric.utilities.rank_zero import rank_zero_only

from geoskill.cli.progress import show_progress


@pytest.mark.parametrize(
    ("rank", "terminal", "hidden"), [(0, True, False), (0, False, True), (1, True, True), (1, False, True)]
)
def test_progress_is_shown_by_the_first_process_on_a_terminal(
    monkeypatch: pytest.MonkeyPatch, rank: int, terminal: bool, hidden: bool
) -> None:
    settings: dict[str, Any] = {}
    monkeypatch.setattr("geoskill.cli.progress.track", lambda items, **given: settings.update(given) or items)
    monkeypatch.setattr("sys.stdout.isatty", lambda: terminal)
    monkeypatch.setattr(rank_zero_only, "rank", rank)
    assert list(show_progress(range(3), "counting")) == [0, 1, 2]
    assert settings["disable"] is hidden


def test_progress_without_lightning(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delitem(sys.modules, "lightning.fabric.utilities.rank_zero")
    assert list(show_progress(range(3), "counting")) == [0, 1, 2]
