"""What all commands share: the typed configuration of a run, and what happens when something goes wrong."""

import errno
import functools
import os
import shutil
import sys
import tempfile
import threading
import traceback
import warnings
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Final, TextIO, TypeVar, final

import hydra
from hydra._internal.utils import get_args_parser
from hydra.core.hydra_config import HydraConfig
from hydra.types import RunMode
from omegaconf import DictConfig
from omegaconf.errors import OmegaConfBaseException

from geoskill.cli.compose import configuration_folder, explain_composition, refuse_renamed_keys, register_schemas, typed
from geoskill.cli.help import help_text
from geoskill.cli.paths import with_literal_paths
from geoskill.cli.progress import LINES, is_terminal
from geoskill.config import Config
from geoskill.errors import InputError

UNUSABLE_INPUT = 2
FAILURE = 1
INTERRUPTED = 130
SMALL_WRITE = 1_000_000
"""Bytes; a disk with less is full."""
FAILED_RUN = "error.txt"
HELD: Final = ExitStack()
"""What a command keeps until it ends."""

C = TypeVar("C", bound=Config)


@final
@dataclass(frozen=True)
class Run:
    """One run of a command.

    Attributes:
        folder: where its files go; it exists.
        choices: the choice of each group that has a single one, by the group's name.
        overrides: of the command line.
        is_multirun: whether it is one of a sweep.
    """

    folder: Path
    choices: Mapping[str, str]
    overrides: Sequence[str]
    is_multirun: bool


def run_command(name: str, schema: type[C], job: Callable[[C, Run], None]) -> None:
    """Run ``job`` with the configuration ``conf/NAME.yaml`` and the command line's overrides.

    Whatever the user gave wrongly is told in one line, with exit status 2; a failure in the middle of work in one line
    with exit status 1. ``debug=true`` shows the traceback. A run of a sweep leaves that line in its folder, and the
    others go on; :class:`~geoskill.cli.sweep.SweepSummary` tells.

    Args:
        name: of the command.
        schema: its configuration.
        job: what it does.
    """
    # Hydra would print its own message and end with 1 whatever happened; with this it lets exceptions through.
    os.environ["HYDRA_FULL_ERROR"] = "1"
    give_libraries_a_home()
    let_idle_threads_sleep()
    warnings.showwarning = _show_warning

    def guarded(cfg: DictConfig) -> None:
        run = current_run()

        def work() -> None:
            job(typed(cfg, schema, run.overrides), run)

        if run.is_multirun:
            record_failure(work, name, run.folder / FAILED_RUN)
        else:
            _exit_on_error(work, name)  # here, for Hydra would print a line of its own

    def command() -> None:
        options, unknown = get_args_parser().parse_known_args()
        if unknown:
            raise InputError(f"{unknown[0]}: no such option; expected KEY=VALUE (--help shows the keys)")
        if options.help:
            print(help_text(name, schema, program(), Path(configuration_folder())))
            return
        sys.argv[1:] = with_literal_paths(sys.argv[1:], multirun=options.multirun)
        refuse_renamed_keys()
        register_schemas(name, schema)
        hydra.main(version_base="1.3", config_path=configuration_folder(), config_name=name)(
            # Hydra names the run after the function's file.
            functools.wraps(job)(guarded)
        )()

    ended = threading.Event()
    if not is_terminal():
        threading.Thread(target=LINES.keep_alive, args=(ended,), daemon=True).start()
    with HELD:
        try:
            _exit_on_error(command, name)
        finally:
            ended.set()


def current_run() -> Run:
    """Return the run that Hydra is executing."""
    config = HydraConfig.get()
    return Run(
        Path(config.runtime.output_dir),
        {group: choice for group, choice in config.runtime.choices.items() if isinstance(choice, str)},
        list(config.overrides.task),
        config.mode == RunMode.MULTIRUN,
    )


def program() -> list[str]:
    """Return how this command was started, without its arguments."""
    return [sys.executable, sys.argv[0]] if sys.argv[0].endswith(".py") else [sys.argv[0]]


def give_libraries_a_home() -> None:
    """Have the folder of temporary files stand in for a home folder where the user has none, as in some containers.

    Weights & Biases and others look for their settings there, and fail without.
    """
    try:
        Path.home()
    except RuntimeError:
        os.environ["HOME"] = tempfile.gettempdir()


def let_idle_threads_sleep() -> None:
    """Have threads of PyTorch that wait for each other sleep, where others have work for their cores.

    By default they spin for some milliseconds at every operation. On a busy machine that makes a training ten times as
    long (see docs/experiments/speed.md). It has an effect only before PyTorch is imported.
    """
    os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")


def explain(error: BaseException, command: str) -> tuple[int, str]:
    """Return the exit status and the one line for an exception of a command, or for what caused it.

    >>> explain(InputError("seed=x: expected a number"), "train")
    (2, 'seed=x: expected a number')
    """
    for cause in _causes(error):
        if isinstance(cause, InputError):
            return UNUSABLE_INPUT, _one_line(str(cause))
        if isinstance(cause, OSError) and cause.errno in (errno.ENOSPC, errno.EDQUOT, errno.EFBIG):
            return FAILURE, f"{_full_place(cause)}: no space left on the disk; nothing that was complete is lost"
    if isinstance(error, OmegaConfBaseException) or type(error).__module__.startswith("hydra"):
        return UNUSABLE_INPUT, explain_composition(error, command)
    return FAILURE, f"{type(error).__name__}: {_one_line(str(error))} (debug=true shows where)"


def _full_place(error: OSError) -> str:
    """Return where there is no space left."""
    if error.filename2 or error.filename:  # of a move, where to; of a write, nothing
        return str(error.filename2 or error.filename)
    run = HydraConfig.get().runtime.output_dir if HydraConfig.initialized() else "where the run is written"
    temporary = tempfile.gettempdir()
    own = run if Path(run).is_dir() else os.curdir
    free = {place: shutil.disk_usage(place).free for place in (own, temporary)}
    return temporary if free[temporary] < min(free[own], SMALL_WRITE) else run


def _show_warning(
    message: Warning | str,
    category: type[Warning],
    filename: str,
    lineno: int,
    file: TextIO | None = None,
    line: str | None = None,
) -> None:
    """Print a warning in one line, without the place in the source that raised it."""
    print(f"warning: {_one_line(str(message))}", file=file or sys.stderr)


def _show_traceback() -> None:
    if {"debug=true", "debug=True"} & set(sys.argv):
        traceback.print_exc()


def _exit_on_error(work: Callable[[], None], command: str) -> None:
    try:
        work()
    except BrokenPipeError:  # whoever read the output has seen enough, such as head
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        sys.exit(FAILURE)
    except Exception as error:
        _show_traceback()
        status, message = explain(error, command)
        print(f"error: {message}", file=sys.stderr)
        sys.exit(status)
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr)
        sys.exit(INTERRUPTED)


def record_failure(work: Callable[[], None], command: str, path: Path) -> None:
    """Run one job of several; if it fails, write exit status and message to ``path`` and return."""
    path.unlink(missing_ok=True)
    try:
        work()
    except Exception as error:
        _show_traceback()
        status, message = explain(error, command)
        path.write_text(f"{status} {message}\n", encoding="utf-8")


def _causes(error: BaseException) -> list[BaseException]:
    causes = [error]
    while (following := causes[-1].__cause__ or causes[-1].__context__) is not None and following not in causes:
        causes.append(following)
    return causes


def _one_line(message: str) -> str:
    return " ".join(message.split())
