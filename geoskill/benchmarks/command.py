"""What benchmarks share, and what those of one frame and of one step do: more and more features while there is time."""

import platform
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import torch
from hydra.core.hydra_config import HydraConfig
from omegaconf import DictConfig

from geoskill.benchmarks.cases import Case, Job, precisions_of, prepare
from geoskill.benchmarks.measurement import Figures, Work, peak_memory_mb, times_in_turn
from geoskill.benchmarks.table import Row, markdown, write_report
from geoskill.cli.command import configuration_folder, run_command
from geoskill.cli.progress import quiet_libraries
from geoskill.errors import InputError
from geoskill.model.message_passing import PRECISIONS


def run_benchmark(job: Job) -> None:
    """Measure, print the table, and write it where ``hydra.run.dir`` says."""

    def measure(cfg: DictConfig) -> None:
        """Measure."""
        _check(cfg)
        quiet_libraries()
        folder = Path(HydraConfig.get().runtime.output_dir)
        rows: list[Row] = []
        for model in cfg.models:
            for kernel in cfg.kernels:
                known = precisions_of(model)
                for precision in [each for each in cfg.precisions if each in known] or known[:1]:
                    for row in _growing(cfg, job, kernel, model, precision):
                        rows.append(row)
                        print(markdown([row]).splitlines()[-1], flush=True)
                        # After every row: what has been measured is not lost when the rest takes too long.
                        write_report(rows, machine(cfg, cfg.threads), folder, job)
        print("\n" + markdown(rows))
        print(folder)

    run_command("benchmark", measure)


def _growing(cfg: DictConfig, job: Job, kernel: str, model: str, precision: str) -> Iterator[Row]:
    """Rows of more and more features; each way as long as its work is not expected to take too long."""
    before: Row | None = None
    slow: set[str] = set()
    for features in sorted(cfg.features):
        case = Case(job, kernel, model, features, cfg.device, cfg.threads, precision)
        instances = case.instances()
        if before is not None:
            growth = instances / max(before.instances, 1)
            slow |= {way for way, figures in before.ways.items() if figures.median_s * growth > cfg.limit_s}
        if "ours" in slow:
            return
        ways: dict[str, Work] = {way: prepare(case, way) for way in case.ways() if way not in slow}
        times = times_in_turn(ways, cfg.repeats)
        figures = {
            way: Figures(times[way], None if way == "products" else peak_memory_mb(work)) for way, work in ways.items()
        }
        before = Row(kernel, model, precision, features, instances, figures)
        yield before


def _check(cfg: DictConfig) -> None:
    folder = Path(configuration_folder())
    for key, group in (("kernels", "kernel"), ("models", "model")):
        known = sorted(path.stem for path in (folder / group).glob("*.yaml"))
        for name in cfg[key]:
            if name not in known:
                raise InputError(f"{key}={name}: expected some of {', '.join(known)}")
    if not cfg.precisions:
        raise InputError(f"precisions=[]: expected some of {', '.join(PRECISIONS)}")
    for precision in cfg.precisions:
        if precision not in PRECISIONS:
            raise InputError(f"precisions={precision}: expected some of {', '.join(PRECISIONS)}")
    for features in cfg.features:
        if not isinstance(features, int) or features < 2:
            raise InputError(f"features={features}: expected whole numbers of at least 2")
    if cfg.threads < 1:
        raise InputError(f"threads={cfg.threads}: expected at least 1")
    if cfg.limit_s <= 0:
        raise InputError(f"limit_s={cfg.limit_s:g}: expected a positive number of seconds")
    check_run(cfg)


def check_run(cfg: DictConfig) -> None:
    """Refuse a number of repetitions or a device that cannot be.

    Raises:
        InputError: in that case.
    """
    if cfg.repeats < 1:
        raise InputError(f"repeats={cfg.repeats}: expected at least 1")
    if cfg.device not in ("cpu", "cuda"):
        raise InputError(f"device={cfg.device}: expected cpu or cuda")
    if cfg.device == "cuda" and not torch.cuda.is_available():
        raise InputError("device=cuda: PyTorch finds no GPU here; expected device=cpu")


def machine(cfg: DictConfig, threads: int) -> dict[str, Any]:
    """What the figures are of."""
    gpu = torch.cuda.get_device_name() if cfg.device == "cuda" else None
    return {
        "processor": platform.processor() or platform.machine(),
        "gpu": gpu,
        "threads": threads,
        "torch": torch.__version__,
        "repeats": cfg.repeats,
    }
