"""Robust weights of residuals (Tukey's biweight; Beaton and Tukey, Technometrics 1974)."""

from typing import Final

import numpy as np
from jaxtyping import Float64

TUKEY: Final = 4.685
"""Residual beyond which the biweight is 0, in standard deviations: 95 % efficient for normal errors."""
MAD_TO_STD: Final = 1.4826
"""Standard deviation of normal errors over their median absolute value."""


def biweight(residuals: Float64[np.ndarray, " m"], scale: float, cutoff: float = TUKEY) -> Float64[np.ndarray, " m"]:
    """Return the weights, in [0, 1], of residuals with a standard deviation of ``scale``.

    Args:
        residuals: of either sign.
        scale: in the unit of the residuals.
        cutoff: residual from which on the weight is 0, in standard deviations.

    >>> biweight(np.array([0.0, 4.685, 9.5]), 2.0).round(4)
    array([1.    , 0.5625, 0.    ])
    """
    return np.square(np.maximum(0.0, 1.0 - (residuals / (cutoff * scale)) ** 2))
