"""``kernel=auto``: which constraints a demonstration is about, from the tracks of its features, before any training.

::

    1  come together    the best association loses much of its error in at least half of the frames
    2  beyond chance    as many come together after at most one in twenty random motions, in the median frame
    3  say it once      of those, the ones that fix more of the motion first; one that fixes nothing more is dropped
    4  place            what is carried ends somewhere: while shifts in the picture are left free, the one that fixes
                        most of them is kept, beyond chance or not

How much of the motion is fixed is a rank (:mod:`geoskill.training.picture_rank`). Features, flow and tracks are common
to all candidates, and only what is kept is trained. It learns as it does when it is named, since members do not mix
(docs/experiments/auto.md).
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Final, final

import numpy as np
import torch

from geoskill.data.transitions import Transitions
from geoskill.graphs.motif_graph import MotifGraph
from geoskill.kernels.kernel import Kernel
from geoskill.model.evidence import MIN_APPROACHED
from geoskill.model.kernel_model import KernelModel
from geoskill.skill.choice import Choice
from geoskill.training.coincidences import coincidences
from geoskill.training.evidence import MUCH_PROGRESS
from geoskill.training.picture_rank import SHIFTS, picture_rank
from geoskill.training.selected_frames import first_demonstration

MAX_FRAMES: Final = 32
"""Frames looked at, evenly spread."""
MAX_CHANCE: Final = 0.05
"""Beyond chance is what at most this share of random motions brings about."""


def choose(members: Mapping[str, KernelModel], demonstration: Transitions) -> Choice:
    """Return which members describe a demonstration; of several, the first.

    Args:
        members: the candidates by name, untrained.
        demonstration: with tracks.
    """
    found = {name: _look(member, first_demonstration(name, demonstration)) for name, member in members.items()}
    dropped = {
        name: f"its associations come together in {own.together:.0%} of the frames only"
        for name, own in found.items()
        if own.together < MIN_APPROACHED
    }
    if len(dropped) == len(found):  # nothing to go by; whether anything was learned is said after training
        best = max(found, key=lambda name: (found[name].together, found[name].progress))
        return Choice((best,), {name: reason for name, reason in dropped.items() if name != best})
    candidates = {name: own for name, own in found.items() if name not in dropped}
    dropped |= _worse_descriptors(candidates)
    candidates = {name: own for name, own in candidates.items() if name not in dropped}
    kept = dict[str, _Finding]()
    certain = [name for name, own in candidates.items() if own.chance <= MAX_CHANCE]
    for name in sorted(certain, key=lambda name: (-_fixed([candidates[name]]), candidates[name].chance, name)):
        if _fixed([*kept.values(), candidates[name]]) > _fixed(kept.values()):
            kept[name] = candidates[name]
        else:
            dropped[name] = f"fixes nothing that {' and '.join(kept)} left free"
    _complete(kept, candidates)
    chance = "no more come together than by chance (as many after {:.0%} of random motions)"
    dropped |= {
        name: chance.format(own.chance) for name, own in candidates.items() if name not in kept and name not in dropped
    }
    return Choice(
        tuple(name for name in found if name in kept), {name: dropped[name] for name in found if name in dropped}
    )


@final
@dataclass(frozen=True)
class _Finding:
    """What a demonstration says of one member.

    Attributes:
        kernel: of the member.
        together: share of the frames in which an association is known to lose much of its error.
        chance: share of random motions that bring as many together, in the median frame.
        progress: largest goal progress, in the median frame.
    """

    kernel: Kernel
    together: float
    chance: float
    progress: float


def _look(member: KernelModel, graphs: Sequence[MotifGraph]) -> _Finding:
    """Look at frames of a demonstration, evenly spread."""
    rows = np.linspace(0, len(graphs) - 1, min(MAX_FRAMES, len(graphs))).round().astype(int)
    generator = torch.Generator().manual_seed(0)
    frames = [coincidences(member, graphs[row], generator) for row in rows]
    return _Finding(
        member.kernel,
        float(np.mean([frame.progress >= MUCH_PROGRESS for frame in frames])),
        float(np.median([frame.chance for frame in frames])),
        float(np.median([frame.progress for frame in frames])),
    )


def _worse_descriptors(found: Mapping[str, _Finding]) -> dict[str, str]:
    """Return members with a kernel that another one has with better descriptors, and why they are dropped."""
    best: dict[str, str] = {}
    for name, own in found.items():
        rival = best.setdefault(own.kernel.name, name)
        if (own.chance, -own.progress) < (found[rival].chance, -found[rival].progress):
            best[own.kernel.name] = name
    return {
        name: f"{best[own.kernel.name]} says the same" for name, own in found.items() if best[own.kernel.name] != name
    }


def _complete(kept: dict[str, _Finding], candidates: Mapping[str, _Finding]) -> None:
    """Add to what is kept until the place in the picture is fixed, or nothing fixes more of it."""

    def gain(name: str) -> tuple[int, int, float]:
        joined = [*kept.values(), candidates[name]]
        return _fixed(joined, shifts_only=True), _fixed(joined), candidates[name].progress

    while (fixed := _fixed(kept.values(), shifts_only=True)) < SHIFTS:
        best = max((name for name in candidates if name not in kept), key=gain, default=None)
        if best is None or gain(best)[0] <= fixed:
            return
        kept[best] = candidates[best]


def _fixed(found: Iterable[_Finding], *, shifts_only: bool = False) -> int:
    return picture_rank([own.kernel for own in found], shifts_only=shifts_only)
