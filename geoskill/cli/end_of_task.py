"""The frame of a video in which the task is done, and what the associations determine there."""

from dataclasses import replace
from typing import Any, final

from geoskill.io.frames import Frame
from geoskill.skill.association import InferenceResult
from geoskill.skill.member_status import State
from geoskill.skill.skill import Skill


@final
class EndOfTask:
    """The last frame at the goal, or else the last one in which something is selected.

    Attributes:
        seen: the frame and what is selected in it; None until there is one.
    """

    def __init__(self) -> None:
        self.seen: tuple[Frame, InferenceResult] | None = None
        self._is_done = False

    def add(self, frame: Frame, result: InferenceResult) -> None:
        """Take in what is selected in the next frame."""
        is_done = State.AT_GOAL in result.states.values()
        if result.associations and (is_done or not self._is_done):
            self.seen, self._is_done = (frame, result), is_done

    def decidability(self, skill: Skill) -> dict[str, Any] | None:
        """Return what the associations determine, as plain values; None without any.

        Those of a member that learned nothing from its demonstration determine nothing.
        """
        if self.seen is None:
            return None
        frame, result = self.seen
        nothing = {name for name, evidence in skill.evidence.items() if not evidence.found}
        result = replace(result, associations=tuple(own for own in result.associations if own.member not in nothing))
        height, width = frame.image.shape[:2]
        found = skill.decidability(result, (width, height))
        return None if found is None else found.as_plain()
