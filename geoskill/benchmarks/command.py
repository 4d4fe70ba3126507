"""The command behind the benchmarks of one frame and of one training step."""

from pathlib import Path

from hydra.core.hydra_config import HydraConfig
from omegaconf import DictConfig

from geoskill.benchmarks.cases import Job
from geoskill.benchmarks.grid import Grid
from geoskill.benchmarks.machine import describe_machine
from geoskill.benchmarks.table import Row, markdown, write_report
from geoskill.cli.command import run_command
from geoskill.cli.progress import quiet_libraries


def run_benchmark(job: Job) -> None:
    """Run the command of a benchmark: measure, print the table, and write the report to ``hydra.run.dir``."""

    def measure(cfg: DictConfig) -> None:
        _measure(_grid(cfg), job, Path(HydraConfig.get().runtime.output_dir))

    run_command("benchmark", measure)


def _grid(cfg: DictConfig) -> Grid:
    """Translate the configuration; nothing else in this command reads it."""
    return Grid(
        kernels=tuple(cfg.kernels),
        models=tuple(cfg.models),
        precisions=tuple(cfg.precisions),
        features=tuple(cfg.features),
        repeats=cfg.repeats,
        limit_s=cfg.limit_s,
        threads=cfg.threads,
        device=cfg.device,
    )


def _measure(grid: Grid, job: Job, folder: Path) -> None:
    quiet_libraries()
    machine = describe_machine(grid.device, grid.threads, grid.repeats)
    rows: list[Row] = []
    for row in grid.measure(job):
        rows.append(row)
        print(markdown([row]).splitlines()[-1], flush=True)
        # After every row, so that an interrupted run keeps what was measured.
        write_report(rows, machine, folder, job)
    print("\n" + markdown(rows))
    print(folder)
