"""One command at a time writes into a folder of results; a second one is told who has it before it writes anything."""

import os
import sys
from pathlib import Path
from typing import Any, final

from hydra.experimental.callback import Callback
from omegaconf import DictConfig

from geoskill.cli.command import HELD, UNUSABLE_INPUT
from geoskill.errors import InputError
from geoskill.io.lock import locked


@final
class FolderLock(Callback):
    """Callback that keeps the folder of a run, or of a sweep, until the command ends.

    The further processes of one training share the lock of the first.
    """

    def on_run_start(self, config: DictConfig, **kwargs: Any) -> None:
        """Keep the run's folder, or exit."""
        _hold(config.hydra.run.dir)

    def on_multirun_start(self, config: DictConfig, **kwargs: Any) -> None:
        """Keep the sweep's folder, or exit; its runs lie in there."""
        _hold(config.hydra.sweep.dir)


def _hold(path: str) -> None:
    if any(os.environ.get(name, "0") != "0" for name in ("LOCAL_RANK", "SLURM_PROCID")):
        return
    folder = Path(path).absolute()
    try:
        folder.mkdir(parents=True, exist_ok=True)
        HELD.enter_context(locked(folder))
    except (InputError, OSError) as error:
        cause = error.strerror if isinstance(error, OSError) else None
        message = (
            str(error) if cause is None else f"{folder}: cannot be written ({cause}); expected a folder that can be"
        )
        # An exception would become a warning of Hydra's.
        print(f"error: {message}", file=sys.stderr)
        sys.exit(UNUSABLE_INPUT)
