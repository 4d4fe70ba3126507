"""The grid of cases of one benchmark, measured with more and more features while the time allows it."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import final

from geoskill.benchmarks.cases import Case, Job, available_precisions, prepare
from geoskill.benchmarks.machine import check_run
from geoskill.benchmarks.measurement import Metrics, Workload, peak_memory_mb, time_in_turns
from geoskill.benchmarks.options import kernel_of, network_arguments
from geoskill.benchmarks.table import Row
from geoskill.errors import InputError
from geoskill.model.message_passing import PRECISIONS


@final
@dataclass(frozen=True)
class Grid:
    """All combinations of kernels, networks, precisions and numbers of features, and how they are measured.

    Attributes:
        kernels: names of kernels.
        models: choices of ``model=``.
        precisions: those that a network supports are measured; of one that supports none of them, the first that it
            has.
        features: numbers of features of each of a kernel's node types, each at least 2.
        repeats: timed rounds.
        limit_s: expected seconds of a run from which on a variant is left out.
        threads: number of PyTorch's threads.
        device: of PyTorch, ``cpu`` or ``cuda``.

    Raises:
        InputError: when a name is unknown, a number is too small or the device cannot be used.
    """

    kernels: tuple[str, ...]
    models: tuple[str, ...]
    precisions: tuple[str, ...]
    features: tuple[int, ...]
    repeats: int
    limit_s: float
    threads: int
    device: str

    def __post_init__(self) -> None:
        for kernel in self.kernels:
            kernel_of(kernel)
        for model in self.models:
            network_arguments(model)
        if not self.precisions:
            raise InputError(f"precisions=[]: expected some of {', '.join(PRECISIONS)}")
        for precision in self.precisions:
            if precision not in PRECISIONS:
                raise InputError(f"precisions={precision}: expected some of {', '.join(PRECISIONS)}")
        for count in self.features:
            if not isinstance(count, int) or count < 2:
                raise InputError(f"features={count}: expected whole numbers of at least 2")
        if self.threads < 1:
            raise InputError(f"threads={self.threads}: expected at least 1")
        if self.limit_s <= 0:
            raise InputError(f"limit_s={self.limit_s:g}: expected a positive number of seconds")
        check_run(self.repeats, self.device)

    def measure(self, job: Job) -> Iterator[Row]:
        """Measure one case after another; yield the metrics of each as soon as they are known."""
        for model in self.models:
            for kernel in self.kernels:
                available = available_precisions(model)
                selected = [precision for precision in self.precisions if precision in available]
                for precision in selected or available[:1]:
                    yield from self._measure_growing(job, kernel, model, precision)

    def _measure_growing(self, job: Job, kernel: str, model: str, precision: str) -> Iterator[Row]:
        """Measure more and more features; leave a variant out once its time is expected to exceed the limit."""
        previous: Row | None = None
        slow: set[str] = set()
        for features in sorted(self.features):
            case = Case(job, kernel, model, features, self.device, self.threads, precision)
            instances = case.num_instances()
            if previous is not None:
                growth = instances / max(previous.instances, 1)
                slow |= {
                    variant
                    for variant, metrics in previous.metrics.items()
                    if metrics.timing.median * growth > self.limit_s
                }
            if "dense" in slow:
                return
            workloads: dict[str, Workload] = {
                variant: prepare(case, variant) for variant in case.variants() if variant not in slow
            }
            timings = time_in_turns(workloads, self.repeats)
            metrics = {
                variant: Metrics(timings[variant], None if variant == "matmul_bound" else peak_memory_mb(workload))
                for variant, workload in workloads.items()
            }
            previous = Row(kernel, model, precision, features, instances, metrics)
            yield previous
