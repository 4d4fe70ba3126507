"""Messages of libraries that are meant for others than the users of this package."""

import logging
import warnings
from collections.abc import Iterator
from contextlib import contextmanager

LOGGERS = ("lightning.pytorch.utilities.rank_zero", "lightning.pytorch", "lightning.fabric", "OpenGL")
MESSAGES = (
    ".*does not have many workers.*",  # batches are cut from memory
    ".*smaller than the logging interval.*",
    ".*`torch.jit.script` is deprecated.*",  # PyTorch Geometric calls it when imported
    ".*exists and is not empty.*",
    ".*treespec.*LeafSpec.*is deprecated.*",
    ".*`srun` command is available.*",  # on a login node, and where one task starts its own processes
)


@contextmanager
def quiet_libraries() -> Iterator[None]:
    """Keep the advice of libraries from the terminal while the block runs."""
    levels = {name: logging.getLogger(name).level for name in LOGGERS}
    with warnings.catch_warnings():
        for message in MESSAGES:
            warnings.filterwarnings("ignore", message)
        for name in LOGGERS:
            logging.getLogger(name).setLevel(logging.WARNING)
        try:
            yield
        finally:
            for name, level in levels.items():
                logging.getLogger(name).setLevel(level)
