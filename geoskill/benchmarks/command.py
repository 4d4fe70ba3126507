"""The command behind the benchmarks of one frame and of one training step."""

from pathlib import Path

from geoskill.benchmarks.cases import Job
from geoskill.benchmarks.config import BenchmarkConfig
from geoskill.benchmarks.grid import Grid
from geoskill.benchmarks.machine import describe_machine
from geoskill.benchmarks.table import Row, markdown, write_report
from geoskill.cli.command import Run, run_command
from geoskill.training.quiet import quiet_libraries


def run_benchmark(job: Job) -> None:
    """Run the command of a benchmark: measure, print the table, and write the report to ``hydra.run.dir``."""

    def measure(config: BenchmarkConfig, run: Run) -> None:
        with quiet_libraries():
            _measure(_grid(config), job, run.folder)

    run_command("benchmark", BenchmarkConfig, measure)


def _grid(config: BenchmarkConfig) -> Grid:
    return Grid(
        kernels=tuple(config.kernels),
        models=tuple(config.models),
        precisions=tuple(config.precisions),
        features=tuple(config.features),
        repeats=config.repeats,
        limit_s=config.limit_s,
        threads=config.threads,
        device=config.device,
    )


def _measure(grid: Grid, job: Job, folder: Path) -> None:
    machine = describe_machine(grid.device, grid.threads, grid.repeats)
    rows: list[Row] = []
    for row in grid.measure(job):
        rows.append(row)
        print(markdown([row]).splitlines()[-1], flush=True)
        # After every row, so that an interrupted run keeps what was measured.
        write_report(rows, machine, folder, job)
    print("\n" + markdown(rows))
    print(folder)
