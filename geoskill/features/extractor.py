"""The interface of feature extractors: a detector with its descriptor."""

from abc import ABC, abstractmethod
from typing import ClassVar

import numpy as np
from jaxtyping import UInt8

from geoskill.features.feature_set import FeatureSet
from geoskill.geometry.depth_picture import DepthPicture
from geoskill.geometry.primitives import NodeType


class FeatureExtractor(ABC):
    """A detector and descriptor of features in gray pictures.

    A subclass is final. Its constructor takes plain keyword arguments only (numbers, strings, booleans), since they
    identify it in the cache and in a checkpoint, and keeps them as attributes of the same names.
    """

    name: ClassVar[str]
    """The extractor's name on the command line and in checkpoints; the name of its file."""

    node_type: ClassVar[NodeType]
    descriptor_dim: ClassVar[int]
    has_orientation: ClassVar[bool] = False
    """Whether its feature sets have :attr:`FeatureSet.orientation_px`."""

    needs_depth: ClassVar[bool] = False
    """Whether it finds nothing in a picture without depth."""

    patch_side: ClassVar[int | None] = None
    """Side of the descriptor if it is a square patch of pixels, row by row; otherwise None."""

    @abstractmethod
    def extract(self, image: UInt8[np.ndarray, "height width"], limit: int | None = None) -> FeatureSet:
        """Return the features of a picture, highest score first, in its pixels, with descriptors of unit norm.

        Args:
            image: gray.
            limit: number of features needed, those with the highest scores; others may be left out without being
                described. None for all.
        """

    def extract_in_depth(
        self, image: UInt8[np.ndarray, "height width"], depth: DepthPicture, limit: int | None = None
    ) -> FeatureSet:
        """Return the features of a picture with depth; most extractors do not look at it.

        Args:
            image: gray.
            depth: of the picture, of its size.
            limit: see :meth:`extract`.
        """
        return self.extract(image, limit)
