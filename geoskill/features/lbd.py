"""Line segments with the Line Band Descriptor."""

from typing import ClassVar, final

import numpy as np
from jaxtyping import UInt8

from geoskill.errors import InputError
from geoskill.features.extractor import FeatureExtractor
from geoskill.features.feature_set import FeatureSet
from geoskill.features.line_band_descriptor import DESCRIPTOR_DIM, describe
from geoskill.features.lsd import detect_segments
from geoskill.geometry.primitives import NodeType

MAX_BAND_WIDTH = 63


@final
class Lbd(FeatureExtractor):
    """Segments of the Line Segment Detector with Line Band Descriptors; the score is its length in pixels.

    Args:
        min_length_ratio: shortest segment, as a fraction of the picture's diagonal, in [0, 1).
        band_width: width of each of the nine bands in pixels, odd, at most 63; 7 in the paper.

    Raises:
        InputError: when an argument is out of range, or OpenCV lacks the detector (see :func:`detect_segments`).
    """

    name: ClassVar[str] = "lbd"
    node_type: ClassVar[NodeType] = NodeType.LINE
    descriptor_dim: ClassVar[int] = DESCRIPTOR_DIM

    def __init__(self, *, min_length_ratio: float = 0.015, band_width: int = 7) -> None:
        if not 0 <= min_length_ratio < 1:
            raise InputError(
                f"min_length_ratio is {min_length_ratio}; expected a fraction of the picture's diagonal in [0, 1)"
            )
        if not 1 <= band_width <= MAX_BAND_WIDTH or band_width % 2 == 0:
            raise InputError(f"band_width is {band_width}; expected an odd number of pixels from 1 to {MAX_BAND_WIDTH}")
        self.min_length_ratio = min_length_ratio
        self.band_width = band_width

    def extract(self, image: UInt8[np.ndarray, "height width"], limit: int | None = None) -> FeatureSet:
        """Return the segments of a picture that are long enough, longest first; none without edges."""
        segments, lengths = detect_segments(image, self.min_length_ratio * float(np.hypot(*image.shape)))
        segments, lengths = segments[:limit], lengths[:limit]
        if len(segments) == 0:
            return FeatureSet.empty(self.node_type, self.descriptor_dim)
        return FeatureSet(self.node_type, describe(image, segments, self.band_width), segments, lengths)
