"""A study: variants of one training, each over several seeds, scored on the same test sets.

A job trains one variant with one seed and scores it on all test sets. It is a list of steps, each a command of this
package with its overrides and the folder it writes. A step is complete once that folder holds ``metrics.json``, so a
job can be stopped anywhere and started again.
"""

import json
import logging
import re
import signal
import subprocess
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any, Literal, final

import yaml

from geoskill.cli.paths import with_literal_paths
from geoskill.errors import InputError

log = logging.getLogger(__name__)

CHECKPOINT = "skill.ckpt"
QUICK_TRAINING = ("trainer.max_epochs=2",)
QUICK_EVERY = 10
# Overrides in which a step may differ from an earlier attempt at it: where it goes on, and where its skill lies.
LOCATIONS = ("ckpt_path", "skill")


@final
@dataclass(frozen=True)
class Step:
    """One command, its overrides and the folder that it writes."""

    command: Literal["train", "evaluate"]
    overrides: tuple[str, ...]
    folder: Path

    def is_complete(self) -> bool:
        """Return whether the results are there.

        Raises:
            InputError: when the folder was begun with other overrides.
        """
        stored = self.folder / ".hydra" / "overrides.yaml"
        if stored.is_file():
            begun, wanted = (_settings(lines) for lines in (yaml.safe_load(stored.read_text("utf-8")), self.overrides))
            if begun != wanted:
                only_begun, only_wanted = (
                    " ".join(line for line in lines if line not in others) or "nothing beside the others"
                    for lines, others in ((begun, wanted), (wanted, begun))
                )
                raise InputError(
                    f"{self.folder}: was begun with {only_begun}; expected {only_wanted}, or another hydra.run.dir"
                )
        try:
            self.metrics()
        except FileNotFoundError:
            return False
        except ValueError as error:
            log.warning("%s: is damaged (%s); the step is done again", self.metrics_path, error)
            return False
        return True

    @property
    def metrics_path(self) -> Path:
        """The file that is written last."""
        return self.folder / "metrics.json"

    def metrics(self) -> dict[str, Any]:
        """Return the results of a complete step."""
        return read_metrics(self.metrics_path)

    def perform(self) -> None:
        """Run the command in a process of its own; an interrupted training goes on from its checkpoint.

        Raises:
            InputError: when it ends with exit status 2.
            KeyboardInterrupt: when it was interrupted; the step goes on when it is performed again.
            RuntimeError: when it fails otherwise.
        """
        checkpoint = self.folder / CHECKPOINT
        if self.command == "train" and checkpoint.is_file():
            try:
                return self._call(f"ckpt_path={checkpoint}")
            except InputError as error:  # such as one of another version
                log.warning("%s; training from the beginning", error)
                checkpoint.unlink()
        return self._call()

    def _call(self, *further: str) -> None:
        arguments = [*self.overrides, *further, f"hydra.run.dir={self.folder}"]
        module = f"geoskill.cli.{self.command}"
        ended = subprocess.run([sys.executable, "-m", module, *arguments], capture_output=True, text=True, check=False)
        if ended.returncode != 0:
            message = (ended.stderr.strip().splitlines() or ["no message"])[-1].removeprefix("error: ")
            if ended.returncode == 2:
                raise InputError(message)
            if ended.returncode in (130, -signal.SIGTERM):  # also of a cluster that wants its node back: no failure
                raise KeyboardInterrupt(f"{module}: {message}")
            raise RuntimeError(f"{module} {' '.join(arguments)} ended with status {ended.returncode}: {message}")


@final
@dataclass(frozen=True)
class Job:
    """The training of one variant with one seed, and its scores on all test sets."""

    variant: str
    seed: int
    training: Step
    tests: Mapping[str, Step]

    @property
    def name(self) -> str:
        """What messages call it."""
        return f"{self.variant}, seed {self.seed}"

    def is_complete(self) -> bool:
        """Return whether all steps are complete; see :meth:`Step.is_complete`."""
        complete = [step.is_complete() for step in (self.training, *self.tests.values())]
        return all(complete)

    def perform(self) -> None:
        """Perform the steps that are not complete; see :meth:`Step.perform`."""
        for title, step in {"training": self.training, **self.tests}.items():
            if not step.is_complete():
                log.info("%s: %s", self.name, title)
                step.perform()

    def scores(self, training_metrics: Sequence[str]) -> dict[str, Any]:
        """Return these metrics of the training, where it has them, and by its name all metrics of each test set."""
        trained = {name: value for name, value in self.training.metrics().items() if name in training_metrics}
        return {"seed": self.seed, **trained, **{name: step.metrics() for name, step in self.tests.items()}}


@final
@dataclass(frozen=True)
class Study:
    """What is compared with what.

    Attributes:
        name: of the folder of its results.
        seeds: each variant is trained with each of them.
        variants: by name, the overrides of ``train.py`` that make the variant.
        train: overrides of ``train.py`` that all variants share.
        test_sets: by name, the overrides of ``evaluate.py``; without any, the trainings themselves are compared.
        every: score every so many frames of a test set.
        published: accuracy in percent, by the name of a variant (or any other) and of a test set.
        baseline: whether hand-picked pairs with trackers are shown, on the recordings of simulated test sets.
        data: the folder of the sequences to which overrides refer as ``${artifact.data}``; null until it is given.
    """

    name: str
    seeds: Sequence[int]
    variants: Mapping[str, Sequence[str]]
    train: Sequence[str] = ()
    test_sets: Mapping[str, Sequence[str]] = field(default_factory=dict)
    every: int = 1
    published: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    baseline: bool = False
    data: str | None = None

    def __post_init__(self) -> None:
        for key in ("seeds", "variants"):
            if not getattr(self, key):
                raise InputError(f"artifact.{key} is empty; expected at least one")
        for name in (*self.variants, *self.test_sets):
            if not re.fullmatch(r"\w[\w =.+-]*", name):
                raise InputError(f"artifact: {name!r} cannot be the name of a folder; expected letters and digits")
        if len({_folder_name(name) for name in self.variants}) < len(self.variants):
            raise InputError("artifact.variants: two names make the same folder; expected them to differ in a letter")

    @classmethod
    def from_plain(cls, plain: Mapping[str, Any]) -> "Study":
        """Build the study that the configuration describes.

        Raises:
            InputError: for an unknown key or a missing one, and for data that are not given or not there.
        """
        if plain.get("data", "") is None:
            raise InputError(
                "artifact.data is not set; expected the folder of the labeled sequences (artifact.data=DIR)"
            )
        known = [parameter.name for parameter in fields(cls)]
        for key in plain:
            if key not in known:
                raise InputError(f"artifact.{key}: there is no such key; expected one of {', '.join(known)}")
        for key in ("name", "seeds", "variants"):
            if key not in plain:
                raise InputError(f"artifact.{key} is not set; expected one, as the others in conf/artifact have")
        study = cls(**plain)
        for override in (*study.train, *(setting for test_set in study.test_sets.values() for setting in test_set)):
            key, _, path = override.partition("=")
            if study.data is not None and key in ("task.path", "video") and not Path(path).is_dir():
                raise InputError(
                    f"artifact.data={study.data}: has no folder {Path(path).name}; expected one with frames"
                )
        return study

    def jobs(self, folder: Path, quick: bool) -> list[Job]:
        """Return all jobs, the seeds of a variant one after the other.

        Args:
            folder: each job gets a folder in it.
            quick: take one seed, few epochs and few frames, to see that it works.
        """
        return [
            self._job(variant, seed, folder / _folder_name(variant) / str(seed), quick)
            for variant in self.variants
            for seed in self.seeds[: 1 if quick else None]
        ]

    def _job(self, variant: str, seed: int, folder: Path, quick: bool) -> Job:
        training = (*self.train, *self.variants[variant])
        settings = (*(QUICK_TRAINING if quick else ()), f"seed={seed}", "threads=1", "logger=none")
        # In simulation a skill is scored on the task that it has learned, the last one named.
        simulated = [override for override in training if override.startswith("task=") and override != "task=video"]
        shared = (f"skill={folder / CHECKPOINT}", *simulated[-1:])
        every = f"every={QUICK_EVERY if quick else self.every}"
        tests = {
            name: Step("evaluate", (*shared, *overrides, every), folder / name)
            for name, overrides in self.test_sets.items()
        }
        return Job(variant, seed, Step("train", (*training, *settings), folder), tests)


def read_metrics(path: Path) -> dict[str, Any]:
    """Read a ``metrics.json``.

    Raises:
        FileNotFoundError: when there is none.
        ValueError: when it is damaged.
    """
    metrics = json.loads(path.read_text(encoding="utf-8"))
    if not isinstance(metrics, dict):
        raise ValueError(f"a {type(metrics).__name__} in place of names with values")
    return metrics


def _folder_name(variant: str) -> str:
    return variant.replace("=", "-").replace(" ", "_")


def _settings(overrides: Sequence[str]) -> list[str]:
    # The commands store paths as they were quoted for Hydra.
    return [override for override in with_literal_paths(overrides) if override.partition("=")[0] not in LOCATIONS]
