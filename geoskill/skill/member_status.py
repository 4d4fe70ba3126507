"""What is said of each member of a skill in a frame, whether it selects an association or not."""

from dataclasses import dataclass
from enum import StrEnum
from typing import Any, final

from geoskill.kernels.kernel import error_row_names
from geoskill.model.kernel_model import KernelModel


@final
class State(StrEnum):
    """State of a member in a frame; the values are the names used in files.

    Attributes:
        APPROACHING: an association is selected.
        AT_GOAL: its goal error is certain and within the tolerance, also where another association is selected whose
            error is not certain yet.
        LOST: no association, or none that is confident enough.
        UNSURE: the error made a step that neither the motion of the nodes nor noise explains, and has not been
            confirmed since (:mod:`geoskill.skill.innovation`); and it is not at the goal for certain.
    """

    APPROACHING = "approaching"
    AT_GOAL = "at goal"
    LOST = "lost"
    UNSURE = "unsure"


@final
@dataclass(frozen=True)
class MemberStatus:
    """State of one member in a frame, and the rows of its error, which are the same in every frame.

    Attributes:
        rows: name of each row of its error, such as ``p2p_sift.x``.
        unit: unit of all of them, as printed; empty for errors without unit.
        state: of its top association.
        error_is_certain: whether a controller may use the error.
        goal_error_is_certain: the same of the goal error. Where the association changes, the goal error may go on as it
            was while the error does not.
        agreement: share of its listed associations that agree on one way to the goal, in [0, 1]; None where fewer than
            two have a goal error.
        offset_px: how far the moving thing is from its goal, as most of them agree (:mod:`geoskill.skill.consensus`).
        switched: whether another association is selected than in the frame before, in which there was one, too.
    """

    rows: tuple[str, ...]
    unit: str = "px"
    state: State = State.LOST
    error_is_certain: bool = False
    goal_error_is_certain: bool = False
    agreement: float | None = None
    offset_px: tuple[float, float] | None = None
    switched: bool = False

    def as_json(self) -> dict[str, Any]:
        """Return what the lines of ``associations.jsonl`` say of the member."""
        return {
            "state": str(self.state),
            "switched": self.switched,
            "error_available": [self.error_is_certain] * len(self.rows),
            "goal_error_available": [self.goal_error_is_certain] * len(self.rows),
            "agreement": None if self.agreement is None else round(self.agreement, 4),
            "offset_px": None if self.offset_px is None else [round(value, 4) for value in self.offset_px],
        }

    @classmethod
    def lost(cls, name: str, member: KernelModel) -> "MemberStatus":
        """Return the status of a member without association.

        Args:
            name: of the member.
            member: gives the rows.
        """
        return cls(tuple(f"{name}.{row}" for row in error_row_names(member.kernel)), member.kernel.unit)
