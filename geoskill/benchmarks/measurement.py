"""Time and peak memory of workloads.

Workloads that are compared take turns, so that a machine that slows down for a while slows all of them down.
"""

import weakref
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import final

import torch
from torch import Tensor
from torch.utils._python_dispatch import TorchDispatchMode
from torch.utils._pytree import tree_leaves
from torch.utils.benchmark import Measurement, TaskSpec, timer

Workload = Callable[[], object]
MIB = 1 << 20


@final
@dataclass(frozen=True, eq=False)
class Metrics:
    """Time and memory of one variant of a case.

    Attributes:
        timing: seconds of every round.
        peak_mb: peak memory in MiB beyond what was allocated before; None where it was not measured.
    """

    timing: Measurement
    peak_mb: float | None = None


def single_runs(seconds: Sequence[float], label: str = "") -> Measurement:
    """Return the measurement of runs that were timed one by one and took these seconds.

    >>> single_runs([0.1, 9.0, 0.2]).median
    0.2
    """
    return Measurement(1, list(seconds), TaskSpec(stmt="", setup="", label=label, num_threads=torch.get_num_threads()))


def time_in_turns(workloads: Mapping[str, Workload], repeats: int) -> dict[str, Measurement]:
    """Time every workload ``repeats`` times; in each round they run one after another.

    An additional first round is not timed. The clock waits until the GPU, if there is one, has finished.
    :meth:`torch.utils.benchmark.Timer.timeit` would run a workload twice before every timed run, and so not in turns.
    """
    seconds: dict[str, list[float]] = {name: [] for name in workloads}
    for repetition in range(repeats + 1):
        for name, workload in workloads.items():
            start = timer()
            workload()
            end = timer()
            if repetition > 0:
                seconds[name].append(end - start)
    return {name: single_runs(runs, name) for name, runs in seconds.items()}


def peak_memory_mb(workload: Workload) -> float:
    """Return the peak memory in MiB of all tensors that the workload creates, on CPU and GPU.

    Tensors that existed before do not count, nor does memory that an operation uses only internally.
    """
    with _StorageLedger() as ledger:
        workload()
    peak: float = ledger.peak / MIB
    return peak


@final
class _StorageLedger(TorchDispatchMode):
    """A count of the bytes of all tensor storages from their creation until they are freed."""

    def __init__(self) -> None:
        super().__init__()  # type: ignore[no-untyped-call]
        self._known: set[int] = set()
        self._allocated = 0
        self.peak = 0

    def __torch_dispatch__(
        self,
        func: Callable[..., object],
        types: object,
        args: tuple[object, ...] = (),
        kwargs: dict[str, object] | None = None,
    ) -> object:
        self._record((args, kwargs), created=False)
        result = func(*args, **(kwargs or {}))
        self._record(result, created=True)
        return result

    def _record(self, values: object, created: bool) -> None:
        for value in tree_leaves(values):
            if not isinstance(value, Tensor):
                continue
            storage = value.untyped_storage()
            if id(storage) in self._known:
                continue
            size = storage.nbytes() if created else 0
            self._known.add(id(storage))
            self._allocated += size
            self.peak = max(self.peak, self._allocated)
            weakref.finalize(storage, self._release, id(storage), size)

    def _release(self, identity: int, size: int) -> None:
        self._known.discard(identity)
        self._allocated -= size
