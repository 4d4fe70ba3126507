"""What one step of the loop takes in, keeps, and gives out: plain immutable values."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any, final

import numpy as np

from geoskill.control.action import Action, ActionSpace, Limits, names, twist
from geoskill.control.broyden import SlotJacobians
from geoskill.control.descent import Descent
from geoskill.control.image_motion import ImageMotion, Points
from geoskill.control.rows import Constraint, Row
from geoskill.control.sequence import Phase, PhaseState
from geoskill.control.settings import ServoConfig
from geoskill.control.who_moves import Ledger


@final
class Mode(StrEnum):
    """What the loop is doing; the values are the names used in files."""

    EXPLORE = "explore"
    SERVO = "servo"
    TERMINAL = "terminal"
    HOLD = "hold"
    DONE = "done"
    LOST = "lost"


@final
@dataclass(frozen=True, eq=False)
class Followed:
    """Features of one camera that were followed from the last picture to this one.

    Attributes:
        before: where they were, pixels.
        after: where they are, pixels.
    """

    before: Points
    after: Points

    @classmethod
    def none(cls) -> "Followed":
        """Return no features."""
        return cls(np.zeros((0, 2)), np.zeros((0, 2)))


@final
@dataclass(frozen=True, eq=False)
class Sighting:
    """What is known at one moment.

    Attributes:
        constraints: associations of all pictures.
        followed: features of each camera, followed from its last picture.
        acted: displacement carried out between the pictures; None where it is not known.
        touched: whether the carried thing rests on something.
        motions: the field of each camera where it is known; None to estimate it.
    """

    constraints: Sequence[Constraint] = ()
    followed: Sequence[Followed] = ()
    acted: Action | None = None
    touched: bool = False
    motions: Sequence[ImageMotion] | None = None


@final
@dataclass(frozen=True, eq=False)
class Decision:
    """What the actor is to do.

    Attributes:
        mode: why it is to do so.
        action: displacement of the next step, meters and radians; zeros to stay where it is.
        reason: why it holds or is lost; empty otherwise.
        predicted_mm: standard deviation of the position that is reached, by the rows' noise; None where not known.
        predicted_deg: of the angle about the vertical.
    """

    mode: Mode
    action: Action
    reason: str = ""
    predicted_mm: float | None = None
    predicted_deg: float | None = None

    @property
    def is_final(self) -> bool:
        """Whether the loop has ended; nothing may be commanded any more."""
        return self.mode in (Mode.DONE, Mode.LOST)


@final
@dataclass(frozen=True, eq=False)
class Setup:
    """What stays the same during a run.

    Attributes:
        space: what is commanded.
        config: settings of a step.
        sizes: width and height of each camera's picture, pixels.
        guarded: whether z is a guarded descent.
        uses_slots: whether Broyden's Jacobians of the error take the place of the field's.
        phases: of the task; none to drive all members at once.
    """

    space: ActionSpace
    config: ServoConfig = field(default_factory=ServoConfig)
    sizes: tuple[tuple[int, int], ...] = ((640, 480),)
    guarded: bool = True
    uses_slots: bool = False
    phases: tuple[Phase, ...] = ()


@final
@dataclass(frozen=True, eq=False)
class ServoState:
    """What the loop remembers from one step to the next.

    Attributes:
        mode: of the last step.
        frame: number of the next step.
        probe: number of the next probing move.
        explorations: how often the probing moves were begun.
        probing: whether the last command was a probing move.
        motions: estimated field of each camera; None before anything moved.
        ledgers: what is known of each camera's features.
        slots: Broyden's Jacobians.
        command: last action that was sent.
        travelled: displacement since the beginning.
        way: the last actions that were carried out.
        rms: of the errors in the last step with rows; infinite before.
        history: RMS of the errors, frame by frame, since the thing came to its support.
        supported: whether it has.
        terminal: terminal frames so far.
        held: frames without associations so far.
        back: actions that are left of a retreat.
        phase: of the task.
        descent: what is known of the way down.
    """

    mode: Mode
    command: Action
    travelled: Action
    motions: tuple[ImageMotion | None, ...]
    ledgers: tuple[Ledger, ...]
    frame: int = 0
    probe: int = 0
    explorations: int = 1
    probing: bool = False
    slots: SlotJacobians = field(default_factory=SlotJacobians)
    way: tuple[Action, ...] = ()
    rms: float = float("inf")
    history: tuple[float, ...] = ()
    supported: bool = False
    terminal: int = 0
    held: int = 0
    back: tuple[Action, ...] = ()
    phase: PhaseState = field(default_factory=PhaseState)
    descent: Descent = field(default_factory=Descent)


@final
@dataclass(frozen=True, eq=False)
class Record:
    """What was known and decided in one step, to be logged.

    Attributes:
        frame: number of the step.
        decision: taken.
        rows: that drove it, weights of robust estimation beside them.
        weights: of the rows.
        rank: of the Jacobian over the driven components; 0 without rows.
        rms: of the errors, pixels; None without rows.
        notes: clips, explorations and the like.
    """

    frame: int
    decision: Decision
    rows: Sequence[Row] = ()
    weights: Sequence[float] = ()
    rank: int = 0
    rms: float | None = None
    notes: tuple[str, ...] = ()

    def as_json(self, space: ActionSpace, rate_hz: float) -> dict[str, Any]:
        """Return the neutral record of the step, of which every export is a view."""
        decision = self.decision
        return {
            "frame": self.frame,
            "time_s": round(self.frame / rate_hz, 4),
            "state": str(decision.mode),
            "reason": decision.reason,
            "rows": [
                row_as_json(row, float(weight) * row.weight)
                for row, weight in zip(self.rows, self.weights, strict=True)
            ],
            "dof": names(space.dofs),
            "twist": rounded(twist(space, decision.action, rate_hz), 6),
            "predicted_mm": None if decision.predicted_mm is None else round(decision.predicted_mm, 3),
            "rank": self.rank,
            "rms_px": None if self.rms is None else round(self.rms, 3),
            "notes": list(self.notes),
        }


def row_as_json(row: Row, weight: float) -> dict[str, Any]:
    """Return what the neutral record says of one row; the error is what is to become zero, the target taken off.

    Args:
        row: to be told.
        weight: with which it drives, in [0, 1].
    """
    own = row.constraint
    return {
        "member": own.member,
        "kernel": own.kernel.name,
        "rank": own.rank,
        "camera": own.camera,
        "error": rounded(row.error),
        "target": None if own.target is None else rounded(np.array(own.target)),
        "jacobian": [rounded(line) for line in row.jacobian],
        "weight": round(weight, 4),
        "confidence": round(own.confidence, 4),
        "nodes": [rounded(node, 2) for node in own.nodes],
        "carried": list(own.carried),
    }


def rounded(values: np.ndarray, digits: int = 4) -> list[float]:
    """Return an array as a list of numbers with few digits."""
    return [round(float(value), digits) for value in values]


def limits_of(config: ServoConfig) -> Limits:
    """Return the limits of the settings, in meters and radians."""
    return Limits(
        config.step_mm / 1000,
        float(np.radians(config.step_deg)),
        config.travel_mm / 1000,
        float(np.radians(config.travel_deg)),
        config.down_mm / 1000,
    )
