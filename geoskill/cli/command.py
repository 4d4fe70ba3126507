"""What all commands share: Hydra's configuration, and what happens when something goes wrong."""

import difflib
import errno
import functools
import os
import sys
import traceback
from collections.abc import Callable
from pathlib import Path

import hydra
from hydra._internal.utils import get_args_parser
from hydra.core.hydra_config import HydraConfig
from hydra.types import RunMode
from omegaconf import DictConfig
from omegaconf.errors import OmegaConfBaseException

from geoskill.cli.settings import check_kinds
from geoskill.errors import InputError

UNUSABLE_INPUT = 2
FAILURE = 1
INTERRUPTED = 130
FAILED_RUN = "error.txt"


def configuration_folder() -> str:
    """Where the YAML files lie: inside an installed package, beside the package in a checkout."""
    package = Path(__file__).resolve().parents[1]
    installed = package / "conf"
    return str(installed if installed.is_dir() else package.parent / "conf")


def run_command(name: str, job: Callable[[DictConfig], None]) -> None:
    """Run ``job`` with the configuration ``conf/NAME.yaml`` and the command line's overrides.

    Whatever the user gave wrongly is told in one line, with exit status 2; a failure in the middle of work in one line
    with exit status 1. ``debug=true`` shows the traceback. A run of a sweep leaves that line in its folder, and the
    others go on; :class:`~geoskill.cli.sweep.SweepSummary` tells.
    """
    # Hydra would print its own message and end with 1 whatever happened; with this it lets exceptions through.
    os.environ["HYDRA_FULL_ERROR"] = "1"

    def guarded(cfg: DictConfig) -> None:
        def work() -> None:
            check_kinds(cfg)
            job(cfg)

        if HydraConfig.get().mode == RunMode.MULTIRUN:
            record_failure(work, Path(HydraConfig.get().runtime.output_dir) / FAILED_RUN)
        else:
            _exit_on_error(work)  # here, for Hydra would print a line of its own

    def command() -> None:
        _, unknown = get_args_parser().parse_known_args()
        if unknown:
            raise InputError(f"{unknown[0]}: no such option; expected KEY=VALUE (--help shows the keys)")
        hydra.main(version_base="1.3", config_path=configuration_folder(), config_name=name)(
            # Hydra names the run after the function's file.
            functools.wraps(job)(guarded)
        )()

    _exit_on_error(command)


def let_idle_threads_sleep() -> None:
    """Have threads of PyTorch that wait for each other sleep, where others have work for their cores.

    By default they turn in circles for some milliseconds. Measured on two busy cores, selecting associations with two
    threads beside two that extract features took six times as long. Only before PyTorch is imported has it an effect.
    """
    os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")


def _show_traceback() -> None:
    if {"debug=true", "debug=True"} & set(sys.argv):
        traceback.print_exc()


def _exit_on_error(work: Callable[[], None]) -> None:
    try:
        work()
    except BrokenPipeError:  # whoever read the output has seen enough, such as head
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        sys.exit(FAILURE)
    except Exception as error:
        _show_traceback()
        status, message = explain(error)
        print(f"error: {message}", file=sys.stderr)
        sys.exit(status)
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr)
        sys.exit(INTERRUPTED)


def record_failure(work: Callable[[], None], path: Path) -> None:
    """Run one job of several; if it fails, write exit status and message to ``path`` and return."""
    path.unlink(missing_ok=True)
    try:
        work()
    except Exception as error:
        _show_traceback()
        status, message = explain(error)
        path.write_text(f"{status} {message}\n", encoding="utf-8")


def explain(error: BaseException) -> tuple[int, str]:
    """The exit status and the one line for an exception, or for what caused it.

    >>> explain(InputError("seed=x: expected a number"))
    (2, 'seed=x: expected a number')
    """
    for cause in _causes(error):
        if isinstance(cause, InputError):
            return UNUSABLE_INPUT, _one_line(str(cause))
        if isinstance(cause, OSError) and cause.errno in (errno.ENOSPC, errno.EDQUOT, errno.EFBIG):
            run = HydraConfig.get().runtime.output_dir if HydraConfig.initialized() else "where the run is written"
            place = cause.filename2 or cause.filename or run  # of a move, where to; of a write, nothing
            return FAILURE, f"{place}: no space left on the disk; nothing that was complete is lost"
    if isinstance(error, OmegaConfBaseException) or type(error).__module__.startswith("hydra"):
        return UNUSABLE_INPUT, _hydra_message(error)
    return FAILURE, f"{type(error).__name__}: {_one_line(str(error))} (debug=true shows where)"


def _similar_group(message: str) -> str:
    """What was meant by a word in quotes that is almost the name of a group of options, if any."""
    groups = [path.name for path in Path(configuration_folder()).iterdir() if path.is_dir()]
    found = difflib.get_close_matches(message.partition("'")[2].partition("'")[0], groups, n=1)
    return f"{found[0]}, or " if found else ""


def _causes(error: BaseException) -> list[BaseException]:
    causes = [error]
    while (following := causes[-1].__cause__ or causes[-1].__context__) is not None and following not in causes:
        causes.append(following)
    return causes


def _one_line(message: str) -> str:
    return " ".join(message.split())


def _hydra_message(error: BaseException) -> str:
    message = str(error)
    for noise in ("Config search path", "To append to your config", "See https:", "Set the environment variable"):
        message = message.partition(noise)[0]
    lines = [line.strip() for line in message.splitlines() if line.strip()]
    text = " ".join(line for line in lines if not line.startswith(("full_key:", "object_type=", "reference_type=")))
    if text.startswith("Could not override"):
        # The keys of a task depend on which one it is.
        near = "task=video for a video of yours, or " if "'task." in text else _similar_group(text)
        return f"{text.rstrip('.')}: there is no such key; expected {near}one that --cfg job shows"
    node = next((line.partition(":")[2].strip() for line in lines if line.startswith("full_key:")), "")
    return text if node in text else f"{node}: {text}"
