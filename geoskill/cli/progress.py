"""Progress bars of the commands."""

import sys
from collections.abc import Iterable
from typing import TypeVar

from rich.progress import track

Item = TypeVar("Item")


def show_progress(items: Iterable[Item], description: str, total: int | None = None) -> Iterable[Item]:
    """Show a progress bar over ``items`` on the terminal; of several processes, only the first one shows it.

    Without a terminal there is no bar: its control characters would end up in the output.
    """
    from lightning.fabric.utilities.rank_zero import rank_zero_only

    hidden = getattr(rank_zero_only, "rank", 0) != 0 or not sys.stdout.isatty()
    return track(items, description=description, total=total, transient=True, disable=hidden)
