"""The order of a task: members that settle together are one phase, and what settled before is held in the next.

In simulated insertions lines come together before points do (docs/experiments/phases.md), elsewhere they may not: the
order is learned.
"""

from collections.abc import Mapping
from typing import Final

from geoskill.control.sequence import Phase
from geoskill.control.settling import Settling
from geoskill.model.kernel_model import KernelModel

TOGETHER: Final = 0.05
"""Share of the demonstration within which members settle together."""
BAR_WIDTH: Final = 40


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
