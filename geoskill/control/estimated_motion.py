"""A motion field estimated from what is seen to move, without calibration.

The displacement of a feature at pixel u for the action dq is modeled as affine in u::

    du = Theta (phi(u) ⊗ dq),    phi(u) = (1, (u_x - m_x) / 60, (u_y - m_y) / 60),

with m the median of the moving features. Theta ``[2, 3 n]`` is estimated by a Kalman filter whose covariance P both
rows share. Without process noise it is ridge regression. The part that depends on the place is needed: a turn about the
grip moves every feature another way.
"""

from dataclasses import dataclass, replace
from typing import Final, final

import numpy as np
from jaxtyping import Bool, Float64

from geoskill.control.action import Action, ActionSpace
from geoskill.control.image_motion import ImageMotion, PointJacobians, Points

SCALE_PX: Final = 60.0
"""Distance from the center at which the affine part of the field counts as much as the constant one."""
PRIOR_STD: Final = (900.0, 60.0)
"""Of the constant part: pixels per meter and per radian, as of a thing at an arm's length in a picture of VGA size."""
AFFINE_RATIO: Final = 0.3
DRIFT: Final = 0.02
"""Standard deviation that a probing move adds, as a ratio of the prior's."""
FEATURE_STD_PX: Final = 0.5
MODEL_STD_PX: Final = 0.3
GATE: Final = 5.0
"""Innovation beyond which a feature is left out, in standard deviations."""
MIN_SHARE: Final = 0.03
"""Of a probing move; a smaller action says nothing."""


@final
@dataclass(frozen=True, eq=False)
class EstimatedMotion(ImageMotion):
    """The estimate, and how sure it is.

    Attributes:
        theta: the coefficients: constant part, along x, along y.
        covariance: of each of its rows.
        center: m, pixels.
        probe: displacement of a probing move in each component.
        prior_std: standard deviation of each coefficient before anything was seen.
    """

    theta: Float64[np.ndarray, "2 c"]
    covariance: Float64[np.ndarray, "c c"]
    center: Float64[np.ndarray, "2"]
    probe: Action
    prior_std: Float64[np.ndarray, " c"]

    @classmethod
    def prior(
        cls, space: ActionSpace, probe: Action, center: Float64[np.ndarray, "2"], height: int = 480
    ) -> "EstimatedMotion":
        """Return the field before anything was seen.

        Args:
            space: what is commanded.
            probe: displacement of a probing move in each component.
            center: of the features, pixels.
            height: of the picture, pixels; the prior is for 480 and grows with it.
        """
        constant = height / 480 * space.of(*PRIOR_STD)
        std = np.concatenate([constant, AFFINE_RATIO * constant, AFFINE_RATIO * constant])
        return cls(np.zeros((2, 3 * len(probe))), np.diag(std**2), np.asarray(center, np.float64), probe, std)

    def _features(self, points: Points) -> Float64[np.ndarray, "m 3"]:
        return np.column_stack([np.ones(len(points)), (points - self.center) / SCALE_PX])

    def jacobian(self, points: Points) -> PointJacobians:
        """See :meth:`ImageMotion.jacobian`."""
        parts = self.theta.reshape(2, 3, -1)
        return np.asarray(np.einsum("mk,dkn->mdn", self._features(points), parts))

    def recentered(self, center: Float64[np.ndarray, "2"]) -> "EstimatedMotion":
        """Return the same field about another center, exactly."""
        shift = (center - self.center) / SCALE_PX
        n = len(self.probe)
        transfer = np.eye(3 * n)
        for part, amount in enumerate(shift, start=1):
            transfer[:n, part * n : (part + 1) * n] = amount * np.eye(n)
        return replace(
            self,
            theta=self.theta @ transfer.T,
            covariance=transfer @ self.covariance @ transfer.T,
            center=np.asarray(center, np.float64),
        )

    def agreeing(self, before: Points, after: Points, action: Action) -> Bool[np.ndarray, " m"]:
        """Return which displacements are within the gate of what the field expects."""
        rows = np.einsum("mk,n->mkn", self._features(before), action).reshape(len(before), -1)
        variance = np.einsum("mc,cd,md->m", rows, self.covariance, rows) + self.measurement_variance
        innovation = (after - before) - rows @ self.theta.T
        return np.asarray((innovation**2).max(axis=1, initial=0.0) <= GATE**2 * variance)

    @property
    def measurement_variance(self) -> float:
        """Variance of the difference of two detections, and of what the model leaves out, pixels squared."""
        return 2 * FEATURE_STD_PX**2 + MODEL_STD_PX**2

    def observed(self, before: Points, after: Points, action: Action) -> "EstimatedMotion":
        """See :meth:`ImageMotion.observed`."""
        share = float(np.linalg.norm(action / self.probe))
        if len(before) == 0 or share < MIN_SHARE or not np.isfinite(action).all():
            return self
        kept = self.agreeing(before, after, action) & np.isfinite(after).all(axis=1) & np.isfinite(before).all(axis=1)
        if not kept.any():
            return self
        before, after = before[kept], after[kept]
        rows = np.einsum("mk,n->mkn", self._features(before), action).reshape(len(before), -1)
        covariance = self.covariance + min(1.0, share) * np.diag((DRIFT * self.prior_std) ** 2)
        # The information form: as many unknowns as coefficients, however many features there are.
        gain = np.linalg.inv(covariance) + rows.T @ rows / self.measurement_variance
        covariance = np.linalg.inv(gain)
        covariance = (covariance + covariance.T) / 2
        innovation = (after - before) - rows @ self.theta.T
        theta = self.theta + (covariance @ rows.T @ innovation / self.measurement_variance).T
        return replace(self, theta=theta, covariance=covariance).recentered(np.median(after, axis=0))
