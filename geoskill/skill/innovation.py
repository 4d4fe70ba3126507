"""A gate for errors over time: what neither motion nor noise explains is not certain until it is confirmed.

The error of an association is predicted by the flow of its nodes since the last frame. The difference from what was
measured is the innovation. A larger one than noise of detection explains means that another association was selected,
or that a node was taken for another feature::

    error         |      ______           predicted: goes on as the nodes move
                  |_____|                 measured:  a step
    state          appr. unsure appr.     for some frames, in which the error goes on from there
"""

from collections.abc import Sequence
from typing import final

import numpy as np
from jaxtyping import Float64

from geoskill.tuning import InnovationConfig


@final
class InnovationGate:
    """Whether a vector that is measured in every frame can be relied on.

    Args:
        config: the limit of an innovation.
        tolerance: an innovation whose norm is below this never counts as a step, in the unit of the vector.
    """

    def __init__(self, config: InnovationConfig, tolerance: float = 0.0) -> None:
        self._config = config
        self._tolerance = tolerance
        self._frames_left = 0

    @property
    def is_certain(self) -> bool:
        """Whether there was no step, or the last one has been confirmed."""
        return self._frames_left == 0

    def goes_on(
        self,
        predicted: Float64[np.ndarray, " d"],
        predicted_std: Float64[np.ndarray, " d"],
        value: Sequence[float],
        std: Sequence[float],
    ) -> bool:
        """Return whether motion and noise explain a value.

        Args:
            predicted: from the frame before, by the motion since.
            predicted_std: its standard deviation, by row.
            value: that was measured.
            std: its standard deviation, by row.
        """
        innovation = np.subtract(value, predicted)
        if np.linalg.norm(innovation) <= self._tolerance:
            return True
        return bool((np.abs(innovation) <= self._config.max_sigma * np.hypot(predicted_std, std)).all())

    def take_in(self, goes_on: bool, frames: int) -> None:
        """Count a frame.

        Args:
            goes_on: whether motion and noise explain the value of this frame.
            frames: for which the value is not certain after a step that nothing explains, this frame among them.
        """
        self._frames_left = max(0, min(self._frames_left, frames) - 1) if goes_on else max(frames, self._frames_left)
