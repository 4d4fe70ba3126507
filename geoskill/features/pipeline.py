"""The feature pipeline: resize the frame, extract, keep the best features, convert back to the frame's pixels."""

import copy
import hashlib
import math
from dataclasses import replace
from typing import final

import cv2
import numpy as np
from jaxtyping import UInt8

from geoskill.errors import InputError
from geoskill.features.cache import FeatureCache
from geoskill.features.color import COLOR_DIM, colors_around
from geoskill.features.extractor import FeatureExtractor
from geoskill.features.feature_set import FeatureSet
from geoskill.features.lifting import lift
from geoskill.features.preference import MAX_CANDIDATES, FeaturePreference
from geoskill.geometry.depth_picture import DepthPicture
from geoskill.geometry.primitives import centers
from geoskill.geometry.sampling import resized
from geoskill.geometry.transforms import rescale_points
from geoskill.plugins import code_identity

# A strip is enlarged no further than to so many squares of the shorter side that others are enlarged to: one of 200 x 1
# pixels would become 46 million, and the detectors take some hundred bytes for each.
MAX_ENLARGED_SQUARES = 4


@final
class FeaturePipeline:
    """An extractor with the processing that all extractors share.

    Args:
        extractor: detects and describes features.
        max_features: number of features kept per frame, those with the highest scores.
        min_side: pictures whose shorter side has fewer pixels are enlarged to this before extraction (0: never), since
            detectors miss small structures in small pictures; strips that are more than four times as long as wide
            are enlarged less. Coordinates are always returned in the frame's pixels.
        max_side: pictures whose shorter side has more pixels are reduced to this (0: never), since detection takes time
            in proportion to their area.
        color: approximate ratio of the norm of a vivid feature's colors (:mod:`geoskill.features.color`) to the norm of
            its descriptor; 0 for no colors. Extractors without orientation have none.
        cache: keeps extracted features between runs; None for no cache.
        in_space: whether features are lifted into space (:mod:`geoskill.features.lifting`), for which every picture
            needs its depth.

    Attributes:
        preference: what a share of the features is kept for, in place of the highest scores; None for no share.

    Raises:
        InputError: when ``max_features``, ``min_side``, ``max_side`` or ``color`` is out of range.
    """

    def __init__(
        self,
        extractor: FeatureExtractor,
        *,
        max_features: int,
        min_side: int,
        max_side: int = 0,
        color: float = 0.0,
        cache: FeatureCache | None = None,
        in_space: bool = False,
    ) -> None:
        if max_features < 2:
            raise InputError(f"max_features={max_features}: expected at least 2")
        if min_side < 0:
            raise InputError(f"min_side={min_side}: expected 0 (never enlarge) or a number of pixels")
        if max_side != 0 and max_side < max(1, min_side):
            raise InputError(f"max_side={max_side}: expected 0 (never reduce) or at least min_side={min_side}")
        if color < 0:
            raise InputError(f"color={color}: expected 0 (none) or more")
        self.extractor = extractor
        self.max_features = max_features
        self.min_side = min_side
        self.max_side = max_side
        self.color = color if extractor.has_orientation else 0.0
        self.cache = cache
        self.in_space = in_space
        self.preference: FeaturePreference | None = None

    @property
    def descriptor_dim(self) -> int:
        """Return the number of components of a descriptor, colors included."""
        return self.extractor.descriptor_dim + (COLOR_DIM if self.color > 0 else 0)

    @property
    def patch_side(self) -> int | None:
        """Return the side of the square patch of pixels with which a descriptor begins, or None."""
        return self.extractor.patch_side

    @property
    def identity(self) -> str:
        """Return everything besides the frame that the features depend on, as text."""
        extractor_class = type(self.extractor)
        arguments = sorted(vars(self.extractor).items())
        settings = f"{self.max_features} {self.min_side} {self.max_side} {self.color}{' in space' * self.in_space}"
        if self.preference is not None:
            arrays = (*self.preference.groups, self.preference.others)
            settings += " " + hashlib.sha256(b"".join(array.tobytes() for array in arrays)).hexdigest()
        return f"{extractor_class.__module__}.{extractor_class.__qualname__}{arguments} {settings} {cv2.__version__}"

    def preferring(self, preference: FeaturePreference | None) -> "FeaturePipeline":
        """Return this pipeline with another preference."""
        pipeline = copy.copy(self)
        pipeline.preference = preference
        return pipeline

    def in_picture(self) -> "FeaturePipeline":
        """Return this pipeline without lifting of features into space."""
        pipeline = copy.copy(self)
        pipeline.in_space = False
        return pipeline

    def extract(self, frame: UInt8[np.ndarray, "height width 3"], depth: DepthPicture | None = None) -> FeatureSet:
        """Return at most ``max_features`` features of an RGB frame, highest score first, in pixels of the frame.

        Args:
            frame: the picture.
            depth: its depth; not used unless :attr:`in_space`.

        Raises:
            InputError: when it is needed and not given.
        """
        if not self.in_space:
            depth = None
        elif depth is None:
            raise InputError(
                f"the features of {self.extractor.name} are wanted in space; expected depth beside pictures"
            )
        if self.cache is None:
            return self._extract(frame, depth)
        identity = self.identity + code_identity(type(self.extractor))
        return self.cache.get_or_compute(frame, identity, lambda: self._extract(frame, depth), depth)

    def candidates(self, frame: UInt8[np.ndarray, "height width 3"], depth: DepthPicture | None = None) -> FeatureSet:
        """Return the features of an RGB frame from which :attr:`preference` chooses; see :meth:`extract`."""
        pipeline = self.preferring(None)
        pipeline.max_features = self._max_candidates
        return pipeline.extract(frame, depth)

    @property
    def _max_candidates(self) -> int:
        return max(self.max_features, MAX_CANDIDATES)

    def _extract(self, frame: UInt8[np.ndarray, "height width 3"], depth: DepthPicture | None) -> FeatureSet:
        if self.preference is None:
            return self._lifted(self._described(frame, depth, self.max_features), depth)
        # Cached as what is chosen of them, not as all there are.
        candidates = self._described(frame, depth, self._max_candidates)
        return self._lifted(candidates.take(self.preference.choose(candidates, self.max_features)), depth)

    @staticmethod
    def _lifted(features: FeatureSet, depth: DepthPicture | None) -> FeatureSet:
        if depth is None or features.space is not None:
            return features
        space, covariance = lift(features.node_type, features.geometry, depth)
        return replace(features, space=space, space_covariance=covariance)

    def _described(
        self, frame: UInt8[np.ndarray, "height width 3"], depth: DepthPicture | None, limit: int
    ) -> FeatureSet:
        gray = cv2.cvtColor(frame, cv2.COLOR_RGB2GRAY)
        height, width = gray.shape
        shorter = min(height, width)
        factor = self.min_side / shorter
        factor = max(1.0, min(factor, self.min_side * math.sqrt(MAX_ENLARGED_SQUARES / (height * width))))
        if factor > 1.0:
            size = (round(width * factor), round(height * factor))
            gray = cv2.resize(gray, size, interpolation=cv2.INTER_CUBIC)
        elif self.max_side and shorter > self.max_side:
            gray = resized(np.asarray(gray, np.uint8), self.max_side / shorter)
        gray = np.asarray(gray, np.uint8)
        if depth is None:
            features = self.extractor.extract(gray, limit)
        else:
            features = self.extractor.extract_in_depth(gray, depth.resized(*gray.shape[::-1]), limit)
        # Not a slice, which would keep the arrays of all detected features in memory.
        features = features.take(np.arange(min(len(features), limit)))
        ratios = width / gray.shape[1], height / gray.shape[0]
        geometry = rescale_points(features.geometry, *ratios).astype(np.float32)
        descriptors = features.descriptors
        if self.color > 0:
            assert features.orientation_px is not None
            orientation_px = features.orientation_px * np.array(ratios, np.float32)
            colors = self.color * colors_around(frame, centers(geometry).astype(np.float32), orientation_px)
            descriptors = np.concatenate([descriptors, colors], axis=1)
            descriptors = descriptors / np.linalg.norm(descriptors, axis=1, keepdims=True)
        return replace(features, descriptors=descriptors, geometry=geometry, orientation_px=None)
