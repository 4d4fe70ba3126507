"""A folder of its own for every run: two that start in the same second must not write into one."""

import contextlib
import functools
import itertools
from pathlib import Path

from omegaconf import OmegaConf

from geoskill.errors import InputError


def register_new_folder() -> None:
    """Let the configuration say ``${new_folder:PATH}``, which makes that folder; see :func:`claim_folder`."""
    # The cache keeps the answer within one configuration, and Hydra hands it on to the runs of a sweep.
    OmegaConf.register_new_resolver("new_folder", claim_folder, use_cache=True, replace=True)


@functools.cache  # of this process, in which Hydra composes its configuration more than once
def claim_folder(path: str) -> str:
    """Make a folder that was not there, and return its path: the given one, or with a number behind it.

    Raises:
        InputError: when it cannot be made.
    """
    try:
        Path(path).parent.mkdir(parents=True, exist_ok=True)
        for candidate in itertools.chain([path], (f"{path}-{number}" for number in itertools.count(2))):
            with contextlib.suppress(FileExistsError):
                Path(candidate).mkdir()
                return candidate
    except OSError as error:
        raise InputError(f"{path}: cannot be made ({error.strerror}); expected a folder for the run") from error
    raise AssertionError("there is always another number")
