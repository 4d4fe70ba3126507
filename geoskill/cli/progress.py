"""Progress of the commands: a bar on a terminal; elsewhere, as in a log file, lines, and never a minute without one."""

import sys
import threading
import time
from collections.abc import Iterable, Iterator, Sized
from typing import Final, TypeVar, final

from rich.progress import track

Item = TypeVar("Item")

LINE_S = 15.0
"""Seconds between two lines of one stage, where there is no terminal."""
SILENCE_S = 50.0
"""Seconds without a line after which one says that the work goes on."""


@final
class ProgressLines:
    """The lines of a command that has no terminal.

    Attributes:
        stage: what is being done.
        last_s: time of the last line, of the monotonic clock.
    """

    def __init__(self) -> None:
        self.stage = "starting"
        self.last_s = time.monotonic()
        self._began_s = self.last_s

    def say(self, line: str) -> None:
        """Print a line at once."""
        self.last_s = time.monotonic()
        print(line, flush=True)

    def enter(self, stage: str) -> None:
        """Say which stage begins, or what of it is done, after a colon: ``training: epoch 1 of 16``."""
        self.stage = stage.partition(":")[0]
        self.say(stage)

    def keep_alive(self, ended: threading.Event) -> None:
        """Say, until ``ended`` is set, that the work goes on where nothing else was said for :data:`SILENCE_S`."""
        while not ended.wait(max(0.1, self.last_s + SILENCE_S - time.monotonic())):
            if time.monotonic() >= self.last_s + SILENCE_S:
                self.say(f"{self.stage}: still at work after {duration(time.monotonic() - self._began_s)}")


LINES: Final = ProgressLines()
"""Those of this process."""


def is_terminal() -> bool:
    """Return whether somebody watches the output."""
    return sys.stdout.isatty()


def show_stage(description: str) -> None:
    """Say what begins, where there is no terminal; of several processes, only the first one says it."""
    if _rank() == 0 and not is_terminal():
        LINES.enter(description)


def show_progress(items: Iterable[Item], description: str, total: int | None = None) -> Iterable[Item]:
    """Show the progress over ``items``; of several processes, only the first one shows it.

    On a terminal it is a bar. Its control characters would end up in a file, which gets a line at the beginning, every
    :data:`LINE_S` seconds with the time that is left, and at the end.
    """
    if _rank() != 0:
        return items
    if is_terminal():
        return track(items, description=description, total=total, transient=True)
    if total is None and isinstance(items, Sized):
        total = len(items)
    return _told(items, description, total)


def _told(items: Iterable[Item], description: str, total: int | None) -> Iterator[Item]:
    LINES.enter(description if total is None else f"{description}: {total}")
    began_s = time.monotonic()
    for done, item in enumerate(items):
        now_s = time.monotonic()
        if now_s >= LINES.last_s + LINE_S:
            left = "" if not (total and done) else f", {duration((now_s - began_s) / done * (total - done))} left"
            LINES.say(f"{description}: {done}{'' if total is None else f' of {total}'}{left}")
        yield item
    LINES.stage = f"after {description}"


def duration(seconds: float) -> str:
    """Return a time for people.

    >>> [duration(seconds) for seconds in (0.4, 59.7, 61, 3700)]
    ['1 s', '1 min', '1 min', '1 h 2 min']
    """
    if seconds < 59.5:
        return f"{max(1, round(seconds))} s"
    minutes = round(seconds / 60)
    return f"{minutes} min" if minutes < 60 else f"{minutes // 60} h {minutes % 60} min"


def _rank() -> int:
    """Return this process's number among those of a training, 0 where there is no training."""
    # Lightning knows; what has not imported it runs alone, and need not wait two seconds for it.
    lightning = sys.modules.get("lightning.fabric.utilities.rank_zero")
    return int(getattr(getattr(lightning, "rank_zero_only", None), "rank", 0))
