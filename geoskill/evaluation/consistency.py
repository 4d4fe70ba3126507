"""Smoothness of the control error over the frames."""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np


def autocorrelation(values: Sequence[float | None]) -> float | None:
    """Compute the autocorrelation at lag 1 of a series with gaps: 1 if smooth, 0 for noise, -1 if alternating.

    Only pairs of consecutive values that are both known contribute. None when there are fewer than three such pairs, or
    all values are equal.

    >>> autocorrelation([1.0, -1.0, 1.0, -1.0])
    -1.0
    """
    known = np.array([value for value in values if value is not None], np.float64)
    pairs = np.array([pair for pair in pairwise(values) if None not in pair], np.float64)
    if len(pairs) < 3 or known.std() == 0:
        return None
    return float(np.mean((pairs - known.mean()).prod(axis=1)) / known.var())
