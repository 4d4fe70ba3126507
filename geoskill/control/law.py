"""The law: one robust, damped step towards zero error."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final, final

import numpy as np
from jaxtyping import Float64

from geoskill.control.action import Action, ActionSpace, Dof
from geoskill.control.robust import Equations, Weights, robust_weights, solved
from geoskill.control.rows import Row
from geoskill.geometry.uncertainty import DETECTION_STD_PX

TRUST_PX: Final = 40.0
"""Largest predicted change of an association's error in one step: beyond, the linear model is not believed."""


LINEAR_STD_RATIO: Final = 0.1
"""Standard deviation of a height over the whole way that is left: the field is linear, and only estimated."""


@final
@dataclass(frozen=True)
class Height:
    """What a picture says about the component that it does not drive.

    Attributes:
        left_m: displacement that the errors ask for, were the picture to drive it, too; meters.
        std_m: its standard deviation; infinite where the picture does not say.
    """

    left_m: float = 0.0
    std_m: float = float("inf")


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
        height: that is left, by this picture alone.
    """

    action: Action
    weights: Weights
    rms: float
    rank: int
    unit_std: Action
    residual_variance: float
    height: Height = Height()


def step_of(
    rows: Sequence[Row],
    space: ActionSpace,
    driven: Sequence[int],
    guided: Action,
    gain: float,
    ahead: Action | None = None,
) -> Step:
    """Return the step that the rows ask for.

    Args:
        rows: of this frame, at least one.
        space: what is commanded.
        driven: components that the picture drives.
        guided: displacement in the other components in this step, whose effect on the picture is compensated.
        gain: share of the error that the step removes.
        ahead: displacement in the other components that is still to come: the errors that it will remove are none.
    """
    driven, step = list(driven), space.step
    equations = Equations.of(rows, step)
    if ahead is not None:
        equations = replace(equations, error=equations.error + equations.jacobian @ (ahead / step))
    z = space.index(Dof.Z)
    measured = driven if ahead is None or z is None or z in driven else sorted([*driven, z])
    # By what the height explains, too: else those rows would count that agree with what is believed of it.
    robust = robust_weights(equations, measured)
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
    height = Height()
    if ahead is not None and measured != driven:
        height = _height(equations, weights, measured, space)
        height = replace(height, left_m=height.left_m + float(ahead[z]))
    return Step(_trusted(equations, weights, action) * step, robust, rms, _rank(normal), unit_std, variance, height)


def _height(equations: Equations, weights: Weights, components: list[int], space: ActionSpace) -> Height:
    """Return what z would be if all of the components were driven, undamped."""
    normal = equations.normal(weights, components)
    if not np.isfinite(normal).all():
        return Height()
    values, vectors = np.linalg.eigh(normal)
    if not values[0] > 1e-9 * max(float(values[-1]), 1e-9):
        return Height()
    inverse = (vectors / values) @ vectors.T
    action = np.zeros(equations.jacobian.shape[2])
    action[components] = -inverse @ equations.gradient(weights, components, equations.error)
    noise = max(_residual_variance(equations, weights, action, len(components)), 2 * DETECTION_STD_PX**2)
    z, step_m = space.dofs.index(Dof.Z), space.limits.step_m
    own = components.index(z)
    far = float(np.linalg.norm(action)) * step_m  # a turn of one step counts as much as a way of one
    std = np.hypot(np.sqrt(noise * inverse[own, own]) * step_m, LINEAR_STD_RATIO * far)
    return Height(float(action[z]) * step_m, float(std))


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
