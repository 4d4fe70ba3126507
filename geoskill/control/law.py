"""The law: one robust, damped step towards zero error."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, final

import numpy as np
from jaxtyping import Float64

from geoskill.control.action import Action, ActionSpace
from geoskill.control.robust import Equations, Weights, robust_weights, solved
from geoskill.control.rows import Row

TRUST_PX: Final = 40.0
"""Largest predicted change of an association's error in one step: beyond, the linear model is not believed."""


@final
@dataclass(frozen=True, eq=False)
class Step:
    """What the rows of one frame ask for.

    Attributes:
        action: meters and radians, not limited yet.
        weights: of the rows, in [0, 1].
        rms: weighted root mean square of the norms of the errors, pixels; infinite without weight.
        rank: of the weighted Jacobian over the driven components.
        unit_std: standard deviation of each component of the pose for errors of 1 px, meters and radians; 0 where not
            driven.
        residual_variance: of the errors' components about the linear model, pixels squared.
    """

    action: Action
    weights: Weights
    rms: float
    rank: int
    unit_std: Action
    residual_variance: float


def step_of(rows: Sequence[Row], space: ActionSpace, driven: Sequence[int], guided: Action, gain: float) -> Step:
    """Return the step that the rows ask for.

    Args:
        rows: of this frame, at least one.
        space: what is commanded.
        driven: components that the picture drives.
        guided: displacement in the other components in this step, whose effect on the picture is compensated.
        gain: share of the error that the step removes.
    """
    driven, step = list(driven), space.step
    equations = Equations.of(rows, step)
    robust = robust_weights(equations, driven)
    weights = robust * equations.prior
    normal = equations.normal(weights, driven)
    best = solved(normal, equations.gradient(weights, driven, equations.error))
    other = guided / step
    other[driven] = 0.0
    # What the guided components do to the picture is known, so it is compensated in full.
    drift = solved(normal, equations.gradient(weights, driven, equations.jacobian @ other))
    action, unit_std = np.zeros(len(step)), np.zeros(len(step))
    action[driven] = best
    variance = _residual_variance(equations, weights, action, len(driven))
    action[driven] = gain * best + drift
    unit_std[driven] = _unit_std(normal) * step[driven]
    total = float(weights.sum())
    rms = float(np.sqrt(weights @ np.square(equations.error).sum(axis=1) / total)) if total > 0 else float("inf")
    return Step(_trusted(equations, weights, action) * step, robust, rms, _rank(normal), unit_std, variance)


def _trusted(equations: Equations, weights: Weights, action: Action) -> Action:
    """Return the scaled action, shortened until no row that counts is predicted to change by more than is trusted."""
    changes = np.sqrt(np.square(equations.jacobian @ action).sum(axis=1))
    largest = float(changes[weights > 0].max(initial=0.0))
    return action * (TRUST_PX / largest) if largest > TRUST_PX else action


def _rank(normal: Float64[np.ndarray, "k k"]) -> int:
    values = np.sqrt(np.maximum(np.linalg.eigvalsh(normal), 0.0)) if np.isfinite(normal).all() else np.zeros(1)
    return int((values > max(1e-3 * float(values.max(initial=0.0)), 1e-9)).sum())


def _unit_std(normal: Float64[np.ndarray, "k k"]) -> Float64[np.ndarray, " k"]:
    """Return the standard deviation of each driven component for errors of 1 px, in units of the step."""
    values, vectors = np.linalg.eigh(normal) if np.isfinite(normal).all() else (np.zeros(len(normal)), normal)
    largest = float(values.max(initial=0.0))
    if not largest > 0:
        return np.full(len(normal), np.inf)
    return np.asarray(np.sqrt(vectors**2 @ (1 / np.maximum(values, 1e-12 * largest))))


def _residual_variance(equations: Equations, weights: Weights, action: Action, unknowns: int) -> float:
    """Return the weighted variance of what the best action leaves; 0 with no more equations than unknowns."""
    freedom = float(weights @ equations.components) - unknowns
    return float(weights @ np.square(equations.residuals(action))) / freedom if freedom > 0.5 else 0.0
