"""What every detector with its descriptor offers."""

from abc import ABC, abstractmethod
from typing import ClassVar

import numpy as np
from jaxtyping import UInt8

from geoskill.features.feature_set import FeatureSet
from geoskill.geometry.primitives import NodeType


class FeatureExtractor(ABC):
    """Detects features in a gray picture and describes each one.

    A subclass is final, takes only plain keyword arguments (numbers, strings, booleans: they identify it in the cache
    and in a checkpoint) and keeps them as attributes of the same names.
    """

    name: ClassVar[str]
    node_type: ClassVar[NodeType]
    descriptor_dim: ClassVar[int]
    has_arms: ClassVar[bool] = False
    """Whether its features say how far and in which direction they look (:attr:`FeatureSet.arms`)."""

    patch_side: ClassVar[int | None] = None
    """Of descriptors that are square patches of pixels, row by row, the side; None for all others."""

    @abstractmethod
    def extract(self, image: UInt8[np.ndarray, "height width"], limit: int | None = None) -> FeatureSet:
        """The features of a picture, strongest first, in pixels of that picture, descriptors of unit norm.

        Args:
            image: gray.
            limit: how many are used, the strongest ones; those beyond may be left out undescribed. None for all.
        """
