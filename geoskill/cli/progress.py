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
    hidden = _rank() != 0 or not sys.stdout.isatty()
    return track(items, description=description, total=total, transient=True, disable=hidden)


def _rank() -> int:
    """Return this process's number among those of a training, 0 where there is no training."""
    # Lightning knows; what has not imported it runs alone, and need not wait two seconds for it.
    lightning = sys.modules.get("lightning.fabric.utilities.rank_zero")
    return int(getattr(getattr(lightning, "rank_zero_only", None), "rank", 0))
