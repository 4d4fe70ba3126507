"""What is shown, and not shown, while a command works."""

import logging
import os
import warnings
from collections.abc import Iterable, Sequence

from rich.progress import track


def show_progress(items: Sequence[int], description: str) -> Iterable[int]:
    """A bar on the terminal while a sequence is worked off; of several processes, only the first one shows it."""
    from lightning.fabric.utilities.rank_zero import rank_zero_only

    return track(items, description=description, transient=True, disable=getattr(rank_zero_only, "rank", 0) != 0)


def quiet_libraries() -> None:
    """Keep advice that is meant for others than our users from the terminal."""
    os.environ.setdefault("WANDB_SILENT", "true")
    logging.getLogger("lightning.pytorch.utilities.rank_zero").setLevel(logging.WARNING)
    for package in ("lightning.pytorch", "lightning.fabric"):
        logging.getLogger(package).setLevel(logging.WARNING)
    for message in (
        ".*does not have many workers.*",  # batches are cut from memory
        ".*smaller than the logging interval.*",
        ".*`torch.jit.script` is deprecated.*",  # PyTorch Geometric calls it when imported
        ".*exists and is not empty.*",
        ".*treespec.*LeafSpec.*is deprecated.*",
    ):
        warnings.filterwarnings("ignore", message)
