"""The status of a member over the frames of a video: what of its error and goal error is certain, and its state."""

from collections.abc import Sequence
from dataclasses import replace
from typing import final

import numpy as np
from jaxtyping import Float64

from geoskill.model.kernel_model import KernelModel
from geoskill.skill.association import Association, Node
from geoskill.skill.consensus import consensus
from geoskill.skill.innovation import InnovationGate
from geoskill.skill.member_status import MemberStatus, State
from geoskill.skill.node_errors import error_of_nodes
from geoskill.tuning import InnovationConfig


@final
class StatusOverTime:
    """Gates of the error and of the goal error of one member (:mod:`geoskill.skill.innovation`).

    The goal error is predicted like the error: it changes by as much. So it goes on where another pair of the same two
    things is selected, and confirms it.

    Args:
        name: of the member.
        member: gives the error and the tolerance at the goal.
        config: limits.
    """

    def __init__(self, name: str, member: KernelModel, config: InnovationConfig) -> None:
        self._member = member
        self._config = config
        self._lost = MemberStatus.lost(name, member)
        self._error_gate = InnovationGate(config)
        self._goal_gate = InnovationGate(config, float(member.goal.tolerance))
        self._last: Association | None = None
        self._goal: Float64[np.ndarray, " d"] | None = None
        self._is_lost = True

    def advance(
        self, tracked: Sequence[Node] | None, listed: Sequence[Association], *, kept: bool = True
    ) -> MemberStatus:
        """Return the status in the next frame.

        Args:
            tracked: nodes of the last frame's top association where flow leads them; None where that is not known.
            listed: associations of this frame by rank; empty where the member is lost.
            kept: whether the top one is that of the last frame.
        """
        was_lost, self._is_lost = self._is_lost, not listed
        if not listed:
            self._goal = None
            return self._lost
        top = listed[0]
        if self._last is not None:
            self._take_in(self._last, tracked, top)
        elif top.goal is not None:
            self._goal = np.array(top.goal.error)
        self._last = top
        goal_is_certain = top.goal is not None and self._goal_gate.is_certain
        agreed = consensus(self._member.kernel, listed)
        return replace(
            self._lost,
            state=self._state(top, goal_is_certain),
            error_is_certain=self._error_gate.is_certain,
            goal_error_is_certain=goal_is_certain,
            agreement=None if agreed is None else agreed.share,
            offset_px=None if agreed is None else agreed.offset_px,
            switched=not (kept or was_lost),
        )

    def _take_in(self, last: Association, tracked: Sequence[Node] | None, top: Association) -> None:
        """Compare an association with what was predicted from the last one."""
        predicted, std = np.array(last.error), np.array(last.error_std)
        if tracked is not None:
            predicted, std = (np.array(values) for values in error_of_nodes(self._member.kernel, tracked))
        goes_on = self._error_gate.goes_on(predicted, std, top.error, top.error_std)
        goal = None if self._goal is None else self._goal + predicted - last.error
        goal_goes_on = (
            goal is not None
            and top.goal is not None
            and self._goal_gate.goes_on(goal, np.array(top.goal.std), top.goal.error, top.goal.std)
        )
        if top.goal is None:
            frames, self._goal = self._config.frames, goal if goes_on else None
        else:
            self._goal_gate.take_in(goal_goes_on, self._config.goal_frames)
            # The same way is left, so it is another pair of the same two things.
            frames = 1 if goal_goes_on and self._goal_gate.is_certain else self._config.goal_frames
            self._goal = np.array(top.goal.error)
        self._error_gate.take_in(goes_on, frames)

    def _state(self, top: Association, goal_is_certain: bool) -> State:
        if goal_is_certain and top.is_at_goal:
            return State.AT_GOAL  # another pair of the same two things has another error, and is there just as well
        return State.APPROACHING if self._error_gate.is_certain else State.UNSURE
