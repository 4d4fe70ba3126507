"""What is shown, and not shown, while a command works."""

import sys
from collections.abc import Iterable
from typing import TypeVar

from rich.progress import track

Item = TypeVar("Item")


def show_progress(items: Iterable[Item], description: str, total: int | None = None) -> Iterable[Item]:
    """A bar on the terminal while items are worked off; of several processes, only the first one shows it.

    Where there is no terminal there is no bar, whose control characters would get into the last line.
    """
    from lightning.fabric.utilities.rank_zero import rank_zero_only

    hidden = getattr(rank_zero_only, "rank", 0) != 0 or not sys.stdout.isatty()
    return track(items, description=description, total=total, transient=True, disable=hidden)
