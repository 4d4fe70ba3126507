"""The features found in one frame by one extractor."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import final

import numpy as np
from jaxtyping import Float32, Int

from geoskill.geometry.primitives import NodeType


@final
@dataclass(frozen=True, eq=False)
class FeatureSet:
    """``n`` features of one type, strongest first.

    Attributes:
        node_type: what the features are.
        descriptors: ``[n, D]``, each row of unit L2 norm.
        geometry: ``[n, 2]`` points or ``[n, 4]`` segments, in pixels (see :mod:`geoskill.geometry.primitives`).
        strength: ``[n]``, the detector's response, not increasing. Comparable within one frame only.
        arms: ``[n, 2]``, from the middle of each feature, in the direction that its descriptor takes for its own, to
            the edge of what that describes, in pixels; or None where the extractor does not say. Pipelines need it
            for colors, and leave it out of what they return.

    Raises:
        ValueError: when the arrays disagree in length, a row has the wrong width, or a number is not finite.
    """

    node_type: NodeType
    descriptors: Float32[np.ndarray, "n d"]
    geometry: Float32[np.ndarray, "n g"]
    strength: Float32[np.ndarray, " n"]
    arms: Float32[np.ndarray, "n 2"] | None = None

    def __post_init__(self) -> None:
        lengths = (len(self.descriptors), len(self.geometry), len(self.strength))
        if len(set(lengths)) != 1:
            raise ValueError(f"descriptors, geometry and strength have {lengths} rows; expected the same number")
        if self.arms is not None and self.arms.shape != (len(self.strength), 2):
            raise ValueError(f"arms have shape {self.arms.shape}; expected [{len(self.strength)}, 2]")
        expected = self.node_type.geometry_dim
        if self.geometry.ndim != 2 or self.geometry.shape[1] != expected:
            raise ValueError(f"geometry has shape {self.geometry.shape}; expected [n, {expected}] for {self.node_type}")
        for name in ("descriptors", "geometry", "strength"):
            if not np.isfinite(getattr(self, name)).all():
                raise ValueError(f"{name} of a {self.node_type} feature set holds a number that is not finite")
        if np.any(np.diff(self.strength) > 0):
            raise ValueError("features are not sorted; expected the strongest first")

    def __len__(self) -> int:
        return len(self.geometry)

    def take(self, rows: slice | Sequence[int] | Int[np.ndarray, " r"]) -> "FeatureSet":
        """The features of these rows, in this order."""
        arms = None if self.arms is None else self.arms[rows]
        return FeatureSet(self.node_type, self.descriptors[rows], self.geometry[rows], self.strength[rows], arms)

    @classmethod
    def empty(cls, node_type: NodeType, descriptor_dim: int) -> "FeatureSet":
        """No feature at all, with the widths that other frames have."""
        return cls(
            node_type,
            np.zeros((0, descriptor_dim), np.float32),
            np.zeros((0, node_type.geometry_dim), np.float32),
            np.zeros(0, np.float32),
            np.zeros((0, 2), np.float32),
        )
