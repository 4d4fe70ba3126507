"""The features that one extractor found in one frame."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import final

import numpy as np
from jaxtyping import Float32, Int

from geoskill.geometry.primitives import NodeType


@final
@dataclass(frozen=True, eq=False)
class FeatureSet:
    """``n`` features of one type, highest score first.

    Attributes:
        node_type: type of the features.
        descriptors: ``[n, D]``, each row of unit L2 norm.
        geometry: ``[n, 2]`` points or ``[n, 4]`` segments, in pixels (see :mod:`geoskill.geometry.primitives`).
        scores: ``[n]``, the detector's response, not increasing. Comparable within one frame only.
        orientation_px: ``[n, 2]``, the local affine frame: a vector from the center of each feature, in the direction
            that its descriptor takes as x axis, to the edge of the described region, in pixels. Its length is the
            support radius. None if the extractor does not provide it. Pipelines need it for colors, and do not return
            it.
        space: ``[n, s]``, the features in space (see :mod:`geoskill.geometry.primitives`), in meters; NaN where the
            depth is not known. None where the features were not lifted.
        space_covariance: ``[n, s, s]``, of each row of ``space``; None without it.

    Raises:
        ValueError: when the arrays disagree in length, a row has the wrong width, a number in the picture is not
            finite, or the scores increase.
    """

    node_type: NodeType
    descriptors: Float32[np.ndarray, "n d"]
    geometry: Float32[np.ndarray, "n g"]
    scores: Float32[np.ndarray, " n"]
    orientation_px: Float32[np.ndarray, "n 2"] | None = None
    space: Float32[np.ndarray, "n s"] | None = None
    space_covariance: Float32[np.ndarray, "n s s"] | None = None

    def __post_init__(self) -> None:
        lengths = (len(self.descriptors), len(self.geometry), len(self.scores))
        if len(set(lengths)) != 1:
            raise ValueError(f"descriptors, geometry and scores have {lengths} rows; expected the same number")
        if self.orientation_px is not None and self.orientation_px.shape != (len(self.scores), 2):
            raise ValueError(f"orientation_px has shape {self.orientation_px.shape}; expected [{len(self.scores)}, 2]")
        expected = self.node_type.geometry_dim
        if self.geometry.ndim != 2 or self.geometry.shape[1] != expected:
            raise ValueError(f"geometry has shape {self.geometry.shape}; expected [n, {expected}] for {self.node_type}")
        if (self.space is None) != (self.space_covariance is None):
            raise ValueError("space or its covariance is given without the other; expected both, or neither")
        dim = self.node_type.space_dim
        if self.space is not None and self.space.shape != (len(self.scores), dim):
            raise ValueError(f"space has shape {self.space.shape}; expected [{len(self.scores)}, {dim}]")
        for name in ("descriptors", "geometry", "scores"):
            if not np.isfinite(getattr(self, name)).all():
                raise ValueError(f"{name} of a {self.node_type} feature set holds a number that is not finite")
        if np.any(np.diff(self.scores) > 0):
            raise ValueError("features are not sorted; expected the highest score first")

    def __len__(self) -> int:
        return len(self.geometry)

    def take(self, rows: slice | Sequence[int] | Int[np.ndarray, " r"]) -> "FeatureSet":
        """Return the features of these rows, in this order."""
        optional = (self.orientation_px, self.space, self.space_covariance)
        return FeatureSet(
            self.node_type,
            self.descriptors[rows],
            self.geometry[rows],
            self.scores[rows],
            *(None if values is None else values[rows] for values in optional),
        )

    @classmethod
    def empty(cls, node_type: NodeType, descriptor_dim: int) -> "FeatureSet":
        """Return a set without features, its arrays as wide as those of other frames."""
        return cls(
            node_type,
            np.zeros((0, descriptor_dim), np.float32),
            np.zeros((0, node_type.geometry_dim), np.float32),
            np.zeros(0, np.float32),
            np.zeros((0, 2), np.float32),
        )


def joined_features(parts: Sequence[FeatureSet]) -> FeatureSet:
    """Return feature sets of one type one after the other, at least one; scores must not increase in between.

    The orientation is left out. Features are in space where those of all parts are.
    """
    spaces = [part.space for part in parts if part.space is not None]
    covariances = [part.space_covariance for part in parts if part.space_covariance is not None]
    in_space = len(spaces) == len(parts)
    return FeatureSet(
        parts[0].node_type,
        np.concatenate([part.descriptors for part in parts]),
        np.concatenate([part.geometry for part in parts]),
        np.concatenate([part.scores for part in parts]),
        space=np.concatenate(spaces) if in_space else None,
        space_covariance=np.concatenate(covariances) if in_space else None,
    )
