"""How long work takes, and how much memory: of several ways in turn, since machines are noisy."""

import time
import weakref
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from statistics import median
from typing import final

import torch
from torch import Tensor
from torch.utils._python_dispatch import TorchDispatchMode
from torch.utils._pytree import tree_leaves

Work = Callable[[], object]
MIB = 1 << 20


@final
@dataclass(frozen=True)
class Figures:
    """Of one way to do some work.

    Attributes:
        seconds: of every repetition.
        peak_mb: the most memory, in MiB, beyond what was held before; None where it was not measured.
    """

    seconds: tuple[float, ...]
    peak_mb: float | None = None

    @property
    def median_s(self) -> float:
        """Median seconds."""
        return median(self.seconds)


def times_in_turn(ways: Mapping[str, Work], repeats: int) -> dict[str, tuple[float, ...]]:
    """Seconds of every way, ``repeats`` times each, one after the other in every round.

    A first round is not timed. A GPU's work counts until it is done.
    """
    taken: dict[str, list[float]] = {name: [] for name in ways}
    for repetition in range(repeats + 1):
        for name, work in ways.items():
            _wait()
            begun = time.perf_counter()
            work()
            _wait()
            if repetition > 0:
                taken[name].append(time.perf_counter() - begun)
    return {name: tuple(seconds) for name, seconds in taken.items()}


def _wait() -> None:
    if torch.cuda.is_available():
        torch.cuda.synchronize()


def peak_memory_mb(work: Work) -> float:
    """The most memory, in MiB, that the tensors made by the work hold at once, beyond those that were there before.

    Of CPU and GPU alike; what an operation holds only while it runs is not seen.
    """
    with _Ledger() as ledger:
        work()
    peak: float = ledger.peak / MIB
    return peak


@final
class _Ledger(TorchDispatchMode):
    """Keeps account of the storages of tensors from when they are made until they are gone."""

    def __init__(self) -> None:
        super().__init__()  # type: ignore[no-untyped-call]
        self._known: set[int] = set()
        self._held = 0
        self.peak = 0

    def __torch_dispatch__(
        self,
        func: Callable[..., object],
        types: object,
        args: tuple[object, ...] = (),
        kwargs: dict[str, object] | None = None,
    ) -> object:
        self._note((args, kwargs), made=False)
        result = func(*args, **(kwargs or {}))
        self._note(result, made=True)
        return result

    def _note(self, values: object, made: bool) -> None:
        for value in tree_leaves(values):
            if not isinstance(value, Tensor):
                continue
            storage = value.untyped_storage()
            if id(storage) in self._known:
                continue
            size = storage.nbytes() if made else 0
            self._known.add(id(storage))
            self._held += size
            self.peak = max(self.peak, self._held)
            weakref.finalize(storage, self._drop, id(storage), size)

    def _drop(self, identity: int, size: int) -> None:
        self._known.discard(identity)
        self._held -= size
