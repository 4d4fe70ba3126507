"""The order of a task: members that settle together are one phase, and what settled before is held in the next.

In simulated insertions lines come together before points do (docs/experiments/phases.md), elsewhere they may not: the
order is learned.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final, final

from geoskill.model.kernel_model import KernelModel
from geoskill.model.settling import Settling

TOGETHER: Final = 0.05
"""Share of the demonstration within which members settle together."""
UNTIL_FACTOR: Final = 2.0
"""A phase is over when what is left of its errors is below so many thresholds."""
BAR_WIDTH: Final = 40


@final
@dataclass(frozen=True)
class Phase:
    """A part of a task.

    Attributes:
        settling: of the members that settle at the end of this phase, by their names.
        held: members that have settled before.
    """

    settling: Mapping[str, Settling]
    held: tuple[str, ...]

    @property
    def settles_at(self) -> float:
        """Share of the demonstration after which all of its members have settled, in [0, 1]."""
        return max(own.share for own in self.settling.values())

    def as_plain(self) -> dict[str, Any]:
        """Return what ``skill.yaml`` and ``metrics.json`` say of it.

        ``until`` is the norm of what is left of each error (the goal error) below which the phase is over, and
        ``error_at_end`` the norm of the error at the demonstration's end, both in the unit of the error.
        """
        return {
            "members": [*self.settling, *self.held],
            "settles_at": round(self.settles_at, 4),
            "until": {name: round(UNTIL_FACTOR * own.threshold, 4) for name, own in self.settling.items()},
            "error_at_end": {name: round(own.error_at_end, 4) for name, own in self.settling.items()},
        }


def phases_of(members: Mapping[str, KernelModel]) -> tuple[Phase, ...]:
    """Return the phases of a task in their order; members of which it is not known when they settle are in none."""
    known = [(name, member.settling) for name, member in members.items() if member.settling is not None]
    groups: list[dict[str, Settling]] = []
    for name, settling in sorted(known, key=lambda own: own[1].share):
        if not groups or settling.share - next(iter(groups[-1].values())).share > TOGETHER:
            groups.append({})
        groups[-1][name] = settling
    return tuple(
        Phase(group, tuple(name for earlier in groups[:number] for name in earlier))
        for number, group in enumerate(groups)
    )


def timeline(phases: tuple[Phase, ...]) -> list[str]:
    """Return one line for each member: when it settles in the demonstration, as a bar and in percent.

    ::

        l2l_lbd   ##########################..............  settles at 65 %
        p2p_sift  ################################........  settles at 79 %
    """
    settling = {name: own for phase in phases for name, own in phase.settling.items()}
    width = max(map(len, settling), default=0)
    bars = {name: round(BAR_WIDTH * own.share) for name, own in settling.items()}
    return [
        f"{name:<{width}}  {'#' * bars[name]}{'.' * (BAR_WIDTH - bars[name])}  settles at {100 * own.share:.0f} %"
        for name, own in settling.items()
    ]
