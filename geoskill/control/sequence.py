"""Phases of a task: which members of a skill drive, which are held, and which only show the way.

A phase drives its members. What an earlier one settled is held at full weight; what comes later keeps a small one,
which brings the thing near from afar. The next phase begins once the errors of this phase's members stayed below twice
their thresholds; the phase before comes back once one of its members stayed above four times its own. Weights pass
smoothly.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Final, final

from geoskill.control.settling import Settling

NEXT_RATIO: Final = 2.0
BACK_RATIO: Final = 4.0
PATIENCE_FRAMES: Final = 5
PASSAGE_FRAMES: Final = 10
LATER_WEIGHT: Final = 0.1


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
    def members(self) -> tuple[str, ...]:
        """All members that are driven in it, those of earlier phases included."""
        return (*self.settling, *self.held)

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
            "members": list(self.members),
            "settles_at": round(self.settles_at, 4),
            "until": {name: round(NEXT_RATIO * own.threshold, 4) for name, own in self.settling.items()},
            "error_at_end": {name: round(own.error_at_end, 4) for name, own in self.settling.items()},
        }


@final
@dataclass(frozen=True)
class PhaseState:
    """Where in the sequence the loop is.

    Attributes:
        phase: index of the present one.
        settled: consecutive frames in which its members were settled.
        lost: consecutive frames in which a member of the one before was not.
        since: frames since the last change.
        before: weights at the last change, by member.
    """

    phase: int = 0
    settled: int = 0
    lost: int = 0
    since: int = PASSAGE_FRAMES
    before: Mapping[str, float] = field(default_factory=dict)


def smoothstep(share: float) -> float:
    """Return 3 s² - 2 s³ of a share clipped to [0, 1].

    >>> smoothstep(-1.0), smoothstep(0.5), smoothstep(2.0)
    (0.0, 0.5, 1.0)
    """
    share = min(max(share, 0.0), 1.0)
    return share * share * (3 - 2 * share)


def weights_of(phases: tuple[Phase, ...], state: PhaseState) -> dict[str, float]:
    """Return the weight of each member that a phase names."""
    named = {member for phase in phases for member in phase.members}
    driven = {member for phase in phases[: state.phase + 1] for member in phase.members}
    target = {member: 1.0 if member in driven else LATER_WEIGHT for member in named}
    share = smoothstep(state.since / PASSAGE_FRAMES)
    return {
        member: (1 - share) * state.before.get(member, weight) + share * weight for member, weight in target.items()
    }


def advanced(phases: tuple[Phase, ...], state: PhaseState, errors: Mapping[str, float]) -> PhaseState:
    """Return the state after a frame.

    Args:
        phases: in their order.
        state: before.
        errors: norm of the error of each member in this frame; members that are not seen have none, and decide nothing.
    """
    if not phases:
        return state
    weights = weights_of(phases, state)
    state = replace(state, since=state.since + 1)
    present = phases[state.phase]
    own = {member: errors[member] for member in present.settling if member in errors}
    done = bool(own) and all(error < NEXT_RATIO * present.settling[member].threshold for member, error in own.items())
    lost = False
    if state.phase > 0:
        earlier = phases[state.phase - 1].settling
        lost = any(errors[member] > BACK_RATIO * own.threshold for member, own in earlier.items() if member in errors)
    state = replace(state, settled=state.settled + 1 if done else 0, lost=state.lost + 1 if lost else 0)
    if state.lost >= PATIENCE_FRAMES:
        return PhaseState(state.phase - 1, since=0, before=weights)
    if state.settled >= PATIENCE_FRAMES and state.phase + 1 < len(phases):
        return PhaseState(state.phase + 1, since=0, before=weights)
    return state
