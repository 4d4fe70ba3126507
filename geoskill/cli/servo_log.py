"""``servo.jsonl``: the neutral record of every step of the trials of ``servo.py``."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Final, final

from geoskill.errors import InputError
from geoskill.exports.exporter import finite
from geoskill.exports.record import NeutralRecord
from geoskill.io.atomic import atomic_open

STEPS: Final = "servo.jsonl"


@final
class ServoLog:
    """Appends the steps of each trial once it is complete.

    Args:
        folder: of the run.
        complete: number of trials that are complete; lines of others are dropped.

    Raises:
        InputError: when the lines that are there cannot be read.
    """

    def __init__(self, folder: Path, complete: int) -> None:
        self._path = folder / STEPS
        if not self._path.is_file():
            return
        try:
            with self._path.open(encoding="utf-8") as lines, atomic_open(self._path) as kept:
                for line in lines:
                    # The last one may have been cut off.
                    if not line.endswith("\n") or int(json.loads(line)["trial"]) >= complete:
                        break
                    kept.write(line)
        except (OSError, ValueError, KeyError, TypeError) as error:
            raise InputError(f"{self._path}: cannot be read ({error}); expected another hydra.run.dir") from error

    def add(self, trial: int, records: Sequence[NeutralRecord]) -> None:
        """Append the steps of a trial.

        Args:
            trial: its number.
            records: of its steps, in their order.
        """
        with self._path.open("a", encoding="utf-8") as file:
            file.writelines(json.dumps(finite({"trial": trial, **record})) + "\n" for record in records)
