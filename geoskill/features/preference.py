"""Which features of a frame to keep: the strongest, and those that look like what the task is about.

A plain thing has weak features: of the 60 strongest of a frame, none or two lie on a white box or a coaster, where a
shirt has forty. Where a demonstration tells what is carried and where it is put (:mod:`geoskill.tracking.places`), a
share of the features is kept by similarity to that::

    similarity of f to a group = max over the group of f . g  -  max over the others of f . o
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import final

import numpy as np
from jaxtyping import Float32, Int64

from geoskill.features.feature_set import FeatureSet

# Features to choose from: nearly all that SIFT finds in a frame of 640x480. To describe them takes a fifth longer.
MAX_CANDIDATES = 1000
# Share of a frame's features that is kept for each group, as far as any look like it; the rest are the strongest.
GROUP_SHARE = 0.25
# Descriptors kept of each group, and of the others.
MAX_GROUP = 400
MAX_OTHERS = 1200


@final
@dataclass(frozen=True, eq=False)
class FeaturePreference:
    """Descriptors of what is wanted, and of everything else.

    Attributes:
        groups: ``[p, D]`` each, unit norm: features of which a share is kept for each group.
        others: ``[q, D]``, unit norm: what they are to be told from.

    Raises:
        ValueError: when the arrays are not of the same width, or one is empty or not finite.
    """

    groups: tuple[np.ndarray, ...]
    others: np.ndarray

    def __post_init__(self) -> None:
        arrays = (*self.groups, self.others)
        if len({array.shape[1:] for array in arrays}) != 1 or self.others.ndim != 2:
            raise ValueError(f"descriptors of shapes {[array.shape for array in arrays]}; expected [_, D] of one width")
        if not all(len(array) and np.isfinite(array).all() for array in arrays):
            raise ValueError("a group of descriptors is empty or not finite; expected at least one, unit norm")

    def choose(self, features: FeatureSet, count: int) -> Int64[np.ndarray, " r"]:
        """Return the rows of the features to keep, in their order; ``count`` of them, or all where there are fewer."""
        if len(features) <= count:
            return np.arange(len(features))
        other = (features.descriptors @ self.others.T).max(axis=1)
        kept = np.zeros(len(features), bool)
        for group in self.groups:
            similarity = (features.descriptors @ group.T).max(axis=1) - other
            similarity[kept] = -np.inf
            best = np.argsort(-similarity, kind="stable")[: int(GROUP_SHARE * count)]
            kept[best[similarity[best] > 0]] = True
        strongest = np.flatnonzero(~kept)[: count - int(kept.sum())]
        kept[strongest] = True
        return np.flatnonzero(kept)


def merged(preferences: Sequence[FeaturePreference]) -> FeaturePreference:
    """Return one preference of bounded size for several demonstrations of a task, at least one."""
    groups = [np.concatenate(groups) for groups in zip(*(own.groups for own in preferences), strict=True)]
    return FeaturePreference(
        tuple(thinned(group, MAX_GROUP) for group in groups),
        thinned(np.concatenate([own.others for own in preferences]), MAX_OTHERS),
    )


def thinned(rows: Float32[np.ndarray, "n d"], count: int) -> Float32[np.ndarray, "m d"]:
    """Return ``count`` of the rows, evenly spread over them; all where there are fewer."""
    return rows if len(rows) <= count else rows[np.linspace(0, len(rows) - 1, count).round().astype(np.int64)]
