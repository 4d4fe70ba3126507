"""A whole run of the loop on a plant, with its score."""

from collections.abc import Callable
from dataclasses import asdict, dataclass
from time import perf_counter
from typing import Any, final

import numpy as np

from geoskill.control.action import Action
from geoskill.control.plant import Placement, Plant
from geoskill.control.servo import initial_state, step
from geoskill.control.state import Mode, Record, Setup


@final
@dataclass(frozen=True)
class TrialResult:
    """Score of one run.

    Attributes:
        ended: `done` or `lost`.
        reason: why it was lost.
        start_mm: distance from the goal at the start.
        start_deg: angle from the goal at the start.
        mm: distance from the goal at the end, after the thing was let go where that is simulated.
        along_mm: the part along the first camera's line of sight.
        across_mm: the part across it.
        deg: angle from the goal at the end.
        steps: frames, exploration included.
        path_ratio: way of the grip after the exploration, over the straight way.
        held: frames in which nothing drove.
        wrong_top: frames in which the first association was wrong.
        rank: of the last step's Jacobian.
        predicted_mm: what the loop says of its error.
        predicted_deg: likewise.
        seconds: per frame, perception included.
        explorations: that were begun.
        violations: commands beyond a limit, not finite, or after the end; 0 unless something is broken.
    """

    ended: str
    reason: str
    start_mm: float
    start_deg: float
    mm: float
    along_mm: float
    across_mm: float
    deg: float
    steps: int
    path_ratio: float
    held: int
    wrong_top: int
    rank: int
    predicted_mm: float | None
    predicted_deg: float | None
    seconds: float
    explorations: int
    violations: int

    def as_row(self) -> dict[str, Any]:
        """Return the result as a row of a table."""
        return {key: round(own, 4) if isinstance(own, float) else own for key, own in asdict(self).items()}


Watch = Callable[[Record, Placement], None]


def run_trial(setup: Setup, plant: Plant, *, explores: bool = True, watch: Watch | None = None) -> TrialResult:
    """Run the loop until it ends, and return the score.

    Args:
        setup: of the run.
        plant: at its start.
        explores: whether the field has to be estimated.
        watch: is told each record and where the thing then is.
    """
    state = initial_state(setup, explores=explores)
    start = plant.placement()
    began, way, held, violations, rank = perf_counter(), 0.0, 0, 0, 0
    while True:
        decision, state, record = step(setup, state, plant.look())
        held += decision.mode is Mode.HOLD
        rank = record.rank or rank
        if watch is not None:
            watch(record, plant.placement())
        if decision.is_final:
            break
        violations += not _allowed(setup, decision.action)
        if decision.mode is not Mode.EXPLORE:
            way += float(np.linalg.norm((setup.space.basis @ decision.action)[:3]))
        plant.act(decision.action)
    end = plant.released() if decision.mode is Mode.DONE else plant.placement()
    straight = max(start.mm / 1000, 1e-9)
    return TrialResult(
        str(decision.mode),
        decision.reason,
        start.mm,
        start.deg,
        end.mm,
        end.along_mm,
        end.across_mm,
        end.deg,
        state.frame,
        way / straight,
        held,
        plant.wrong_associations(),
        rank,
        decision.predicted_mm,
        decision.predicted_deg,
        (perf_counter() - began) / state.frame,
        state.explorations,
        violations,
    )


def _allowed(setup: Setup, action: Action) -> bool:
    return bool(np.isfinite(action).all() and (np.abs(action) <= setup.space.step * (1 + 1e-9)).all())
