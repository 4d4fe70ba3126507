"""Weights that leave out wrong associations, by the residual of the linear model.

A wrong association is one that no action explains together with the others: its residual ``norm(E + J a)`` is large at
the action a that serves the others. Its error alone says nothing, for far away every error is large. Tukey's biweight
gives such rows no weight at all; least squares and Huber's would let them draw.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, final

import numpy as np
from jaxtyping import Float64

from geoskill.control.action import Action
from geoskill.control.rows import Row
from geoskill.geometry.robust import MAD_TO_STD, biweight

ROUNDS: Final = 6
CONVERGED: Final = 1e-3
"""Change of all weights below which there are no further rounds."""
MIN_SCALE: Final = 1.0
"""Smallest standard deviation of a residual, pixels."""
FIRST_SCALE: Final = 8.0
"""The same in the first round, where the residual is that of a translation all share."""
LEVENBERG: Final = 1e-3
MIN_ROWS: Final = 4
"""Fewer associations cannot be told apart: each has its weight."""

Weights = Float64[np.ndarray, " m"]


@final
@dataclass(frozen=True, eq=False)
class Equations:
    """The rows of one frame as arrays; components that a kernel's error lacks are zero.

    Attributes:
        error: of each association, pixels or units of resolution.
        jacobian: derivative with respect to the action in units of the limits of a step.
        prior: weight of each association from elsewhere than the residuals.
        components: number of components of each error.
        kinds: number of the kernel and camera of each association.
    """

    error: Float64[np.ndarray, "m d"]
    jacobian: Float64[np.ndarray, "m d n"]
    prior: Weights
    components: Weights
    kinds: np.ndarray

    @classmethod
    def of(cls, rows: Sequence[Row], step: Action) -> "Equations":
        """Stack rows, at least one.

        Args:
            rows: of one frame.
            step: limits of a step, by which the action is scaled.
        """
        widest = max(len(row.error) for row in rows)
        error = np.zeros((len(rows), widest))
        jacobian = np.zeros((len(rows), widest, len(step)))
        names: dict[tuple[str, int], int] = {}
        kinds = np.zeros(len(rows), int)
        for index, row in enumerate(rows):
            error[index, : len(row.error)] = row.error
            jacobian[index, : len(row.error)] = row.jacobian * step
            kinds[index] = names.setdefault((row.constraint.kernel.name, row.constraint.camera), len(names))
        prior = np.array([row.weight for row in rows], np.float64)
        return cls(error, jacobian, prior, np.array([len(row.error) for row in rows], np.float64), kinds)

    def residuals(self, action: Action) -> Weights:
        """Return the norm of what a scaled action leaves of each error, by the linear model."""
        return np.asarray(np.sqrt(np.square(self.error + self.jacobian @ action).sum(axis=1)))

    def normal(self, weights: Weights, driven: Sequence[int]) -> Float64[np.ndarray, "k k"]:
        """Return the matrix of the normal equations over the driven components."""
        own = self.jacobian[:, :, driven]
        flat = own.reshape(-1, own.shape[2])
        return np.asarray(flat.T @ (flat * np.repeat(weights, own.shape[1])[:, None]))

    def gradient(
        self, weights: Weights, driven: Sequence[int], of: Float64[np.ndarray, "m d"]
    ) -> Float64[np.ndarray, " k"]:
        """Return the right side of the normal equations, for errors ``of`` the rows."""
        own = self.jacobian[:, :, driven]
        return np.asarray(own.reshape(-1, own.shape[2]).T @ (of * weights[:, None]).reshape(-1))


def robust_weights(equations: Equations, driven: Sequence[int]) -> Weights:
    """Return a weight in [0, 1] for each association, by iteratively reweighted least squares.

    Args:
        equations: of one frame.
        driven: components of the action that the associations may use.
    """
    count = len(equations.error)
    if count < MIN_ROWS:
        return np.ones(count)
    norms = _first_residuals(equations)
    weights = biweight(norms, max(MAD_TO_STD * _median(norms), FIRST_SCALE))
    action = np.zeros(equations.jacobian.shape[2])
    for _ in range(ROUNDS):
        total = weights * equations.prior
        action[list(driven)] = solved(
            equations.normal(total, driven), equations.gradient(total, driven, equations.error)
        )
        residuals = equations.residuals(action)
        before, weights = weights, biweight(residuals, max(MAD_TO_STD * _median(residuals), MIN_SCALE))
        if float(np.abs(weights - before).max()) < CONVERGED:
            break
    return weights


def solved(normal: Float64[np.ndarray, "k k"], gradient: Float64[np.ndarray, " k"]) -> Float64[np.ndarray, " k"]:
    """Return ``-(N + damping)^-1 g``: directions that no row determines stay at rest.

    Zeros where the equations are empty or not finite.
    """
    size = float(normal.trace()) / max(len(normal), 1)
    # Sums of what is not finite are not finite.
    if not (0 < size < np.inf and np.isfinite(float(normal.sum() + gradient.sum()))):
        return np.zeros(len(normal))
    return -np.linalg.solve(normal + LEVENBERG * size * np.eye(len(normal)), gradient)


def _first_residuals(equations: Equations) -> Weights:
    """Return how far each error is from the median of its kind.

    The residuals of least squares would not do: it would already be drawn by what is wrong.
    """
    norms = np.zeros(len(equations.error))
    for kind in range(int(equations.kinds.max()) + 1):
        own = equations.kinds == kind
        errors = equations.error[own]
        norms[own] = np.linalg.norm(errors - np.median(errors, axis=0), axis=1) / 2
    return norms


def _median(values: Weights) -> float:
    # NumPy's own takes ten times as long for a handful of values.
    ordered = np.sort(values)
    return float(ordered[(len(ordered) - 1) // 2] + ordered[len(ordered) // 2]) / 2
