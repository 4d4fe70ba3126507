"""From a frame to its features: enlarge, extract, keep the strongest, return to the frame's pixels."""

from typing import final

import cv2
import numpy as np
from jaxtyping import UInt8

from geoskill.errors import InputError
from geoskill.features.cache import FeatureCache
from geoskill.features.color import COLOR_DIM, colors_around
from geoskill.features.extractor import FeatureExtractor
from geoskill.features.feature_set import FeatureSet
from geoskill.geometry.transforms import rescale_points
from geoskill.plugins import code_identity


@final
class FeaturePipeline:
    """An extractor with what every extractor needs around it.

    Args:
        extractor: finds and describes features.
        max_features: how many features of a frame are kept, strongest first.
        min_side: pictures whose shorter side has fewer pixels are enlarged to it before extraction (0: never), since
            detectors miss the small structures of small pictures. Coordinates always come back in the frame's pixels.
        color: the norm of a vivid feature's colors (:mod:`geoskill.features.color`) over that of its descriptor,
            about; 0 for descriptors of gray alone, as those of extractors that do not say where a feature looks.
        cache: where extracted features are kept between runs, or None.

    Raises:
        InputError: when ``max_features``, ``min_side`` or ``color`` is out of range.
    """

    def __init__(
        self,
        extractor: FeatureExtractor,
        *,
        max_features: int,
        min_side: int,
        color: float = 0.0,
        cache: FeatureCache | None = None,
    ) -> None:
        if max_features < 2:
            raise InputError(f"features.max_features={max_features}: expected at least 2")
        if min_side < 0:
            raise InputError(f"features.min_side={min_side}: expected 0 (never enlarge) or a number of pixels")
        if color < 0:
            raise InputError(f"features.color={color}: expected 0 (none) or more")
        self.extractor = extractor
        self.max_features = max_features
        self.min_side = min_side
        self.color = color if extractor.has_arms else 0.0
        self.cache = cache

    @property
    def descriptor_dim(self) -> int:
        """Of the features that it extracts."""
        return self.extractor.descriptor_dim + (COLOR_DIM if self.color > 0 else 0)

    @property
    def patch_side(self) -> int | None:
        """Of the patch with which a descriptor begins, if it does."""
        return self.extractor.patch_side

    @property
    def identity(self) -> str:
        """Everything besides the frame that the features depend on, as text."""
        kind = type(self.extractor)
        settings = sorted(vars(self.extractor).items())
        own = f"{self.max_features} {self.min_side} {self.color}"
        return f"{kind.__module__}.{kind.__qualname__}{settings} {own} {cv2.__version__}"

    def extract(self, frame: UInt8[np.ndarray, "height width 3"]) -> FeatureSet:
        """At most ``max_features`` features of an RGB frame, strongest first, in pixels of the frame."""
        if self.cache is None:
            return self._extract(frame)
        identity = self.identity + code_identity(type(self.extractor))
        return self.cache.get_or_compute(frame, identity, lambda: self._extract(frame))

    def _extract(self, frame: UInt8[np.ndarray, "height width 3"]) -> FeatureSet:
        gray = cv2.cvtColor(frame, cv2.COLOR_RGB2GRAY)
        height, width = gray.shape
        factor = max(1.0, self.min_side / min(height, width))
        if factor > 1.0:
            size = (round(width * factor), round(height * factor))
            gray = cv2.resize(gray, size, interpolation=cv2.INTER_CUBIC)
        found = self.extractor.extract(np.asarray(gray, np.uint8), self.max_features)
        # Not a slice, which would keep all that was found in memory as long as the few.
        found = found.take(np.arange(min(len(found), self.max_features)))
        ratios = width / gray.shape[1], height / gray.shape[0]
        geometry = rescale_points(found.geometry, *ratios).astype(np.float32)
        descriptors = found.descriptors
        if self.color > 0:
            assert found.arms is not None
            colors = self.color * colors_around(frame, geometry, found.arms * np.array(ratios, np.float32))
            descriptors = np.concatenate([descriptors, colors], axis=1)
            descriptors = descriptors / np.linalg.norm(descriptors, axis=1, keepdims=True)
        return FeatureSet(found.node_type, descriptors, geometry, found.strength)
