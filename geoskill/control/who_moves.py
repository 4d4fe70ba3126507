"""Which features of a picture the actor carries, judged by motion alone.

Nearness says nothing: near the goal the target's features lie among the carried ones. Each displacement d of a feature
speaks for the field's prediction p, or for rest, by the log likelihood ratio ``(|d|² - |d - p|²) / (2 s²)``, where s is
the noise of detection and the field's own error. The sum over the frames in which the feature was followed decides, as
in Wald's sequential test: many small steps say as much as a large one. What fits neither is somebody else's.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, final

import numpy as np
from jaxtyping import Bool, Float64, Int8

from geoskill.control.action import Action
from geoskill.control.image_motion import ImageMotion, Points

EXPLORED_PX: Final = 3.0
"""Displacement in a probing move beyond which a feature is carried, before there is a field."""
NOISE_VARIANCE: Final = 2 * 0.5**2
FIELD_STD_RATIO: Final = 0.175
"""Standard deviation of the field's prediction over its length: two of it are 35 %."""
DECIDED: Final = 3.0
"""Sum from which on a verdict is given: wrong in one of twenty, if prediction and noise are what they seem."""
LARGEST: Final = 8.0
OUTLIER: Final = 25.0
"""Squared residual of either hypothesis, in variances, beyond which neither holds."""
SAME_PX: Final = 3.0
"""Distance within which a node is a feature that was followed."""
FOLLOWED_PX: Final = 1.0
MOVES, UNKNOWN, RESTS = 1, 0, -1

Scores = Float64[np.ndarray, " m"]


@final
@dataclass(frozen=True, eq=False)
class Ledger:
    """What is known of the features of the last picture.

    Attributes:
        points: where they are, pixels.
        scores: evidence that each is carried; negative for rest.
    """

    points: Points
    scores: Scores

    @classmethod
    def empty(cls) -> "Ledger":
        """Return a ledger without features."""
        return cls(np.zeros((0, 2)), np.zeros(0))

    def advanced(self, motion: ImageMotion, before: Points, after: Points, action: Action) -> "Ledger":
        """Return the ledger of the next picture.

        Args:
            motion: the field.
            before: features that were followed, in the last picture.
            after: the same in this one.
            action: carried out in between.
        """
        scores = self._remembered(before)
        evidence, fits = evidence_of(motion.displacement(before, action), after - before)
        return Ledger(after, np.where(fits, np.clip(scores + evidence, -LARGEST, LARGEST), 0.0))

    def explored(self, before: Points, after: Points) -> "Ledger":
        """Return the ledger of the next picture after a probing move, before there is a field."""
        far = np.linalg.norm(after - before, axis=1) > EXPLORED_PX
        return Ledger(after, np.where(far, LARGEST, self._remembered(before)))

    def without(self, features: Bool[np.ndarray, " m"]) -> "Ledger":
        """Return the ledger that knows nothing of some features."""
        return Ledger(self.points, np.where(features, 0.0, self.scores))

    @property
    def carried(self) -> np.ndarray:
        """Which features are carried."""
        return self.scores > DECIDED

    def verdicts_at(self, points: Points) -> Int8[np.ndarray, " m"]:
        """Return the verdict on what is nearby: 1 moves, -1 rests, 0 where nothing is known, or both are there."""
        if len(self.points) == 0 or len(points) == 0:
            return np.zeros(len(points), np.int8)
        near = np.linalg.norm(points[:, None] - self.points[None], axis=2) <= SAME_PX
        moves = (near & (self.scores > DECIDED)).any(axis=1)
        rests = (near & (self.scores < -DECIDED)).any(axis=1)
        return np.asarray(moves.astype(np.int8) - rests.astype(np.int8), np.int8)

    def verdicts_on(self, nodes: Sequence[Float64[np.ndarray, " _"]]) -> list[int]:
        """Return the verdict on points, and on segments by their ends and their middles."""
        points = [node.reshape(-1, 2) for node in nodes]
        points = [np.vstack([own, own.mean(axis=0)]) if len(own) == 2 else own for own in points]
        if not points:
            return []
        verdicts = self.verdicts_at(np.concatenate(points))
        starts = np.cumsum([0, *(len(own) for own in points[:-1])])
        return [int(verdict) for verdict in np.sign(np.add.reduceat(verdicts.astype(int), starts))]

    def _remembered(self, before: Points) -> Scores:
        """Return the scores of features that lie where they were followed to."""
        if len(self.points) == 0 or len(before) == 0:
            return np.zeros(len(before))
        distances = np.linalg.norm(before[:, None] - self.points[None], axis=2)
        nearest = distances.argmin(axis=1)
        close = distances[np.arange(len(before)), nearest] <= FOLLOWED_PX
        return np.where(close, self.scores[nearest], 0.0)


def evidence_of(predicted: Points, went: Points) -> tuple[Scores, np.ndarray]:
    """Return the evidence that features are carried, from one displacement each, and whether either hypothesis holds.

    Predicted 10 px, went 10, 0 and 50; predicted 1 px and went nowhere:

    >>> predicted = np.array([[10.0, 0.0], [10.0, 0.0], [10.0, 0.0], [1.0, 0.0]])
    >>> evidence, fits = evidence_of(predicted, np.array([[10.0, 0.0], [0.0, 0.0], [0.0, 50.0], [0.0, 0.0]]))
    >>> evidence.round(2).tolist(), fits.tolist()
    ([14.04, -14.04, -14.04, -0.94], [True, True, False, True])
    """
    variance = NOISE_VARIANCE + (FIELD_STD_RATIO * np.linalg.norm(predicted, axis=1)) ** 2
    rest, moved = (went**2).sum(axis=1), ((went - predicted) ** 2).sum(axis=1)
    return (rest - moved) / (2 * variance), np.minimum(rest, moved) <= OUTLIER * variance
