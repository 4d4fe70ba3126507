"""Ellipses in the picture, such as rims and round marks, fitted to chains of edge pixels."""

from typing import ClassVar, Final, final

import cv2
import numpy as np
import torch
from jaxtyping import Float, Float32, UInt8

from geoskill.features.extractor import FeatureExtractor
from geoskill.features.feature_set import FeatureSet
from geoskill.features.sift import sift_detector
from geoskill.geometry.ellipses import ellipse_of_axes, point_to_ellipse
from geoskill.geometry.primitives import NodeType

MIN_SEMI_AXIS_PX: Final = 6.0
MIN_AXIS_RATIO: Final = 0.15
"""A flatter ellipse is nearly a stroke."""
MAX_RESIDUAL_PX: Final = 1.0
"""Median distance of a chain's pixels from their ellipse."""
MAX_RESIDUAL_SHARE: Final = 0.05
"""The same as a share of the semi-minor axis: a small square is nearly as round as a small disc."""
MIN_INLIERS: Final = 0.7
"""So many of a chain's pixels are within twice that distance."""
FITS: Final = 3
MIN_COVER: Final = 0.6
"""A chain has to show this share of the way round."""
SECTORS: Final = 24
SAME_PX: Final = 4.0
"""Ellipses whose ends of axes are closer than this, such as both sides of a drawn line, are one feature."""
PATCH_SHARE: Final = 0.5
"""Diameter of the described region's keypoint, as a share of the ellipse's radius; SIFT describes six times as much."""


@final
class Conics(FeatureExtractor):
    """Ellipses by `cv2.fitEllipseAMS`, those of the longest and best fitting chains first, described by SIFT.

    Args:
        low: lower threshold of Canny's edges.
        high: upper threshold.
    """

    name: ClassVar[str] = "conics"
    node_type: ClassVar[NodeType] = NodeType.CONIC
    descriptor_dim: ClassVar[int] = 128
    has_orientation: ClassVar[bool] = True

    def __init__(self, *, low: float = 40.0, high: float = 90.0) -> None:
        self.low = low
        self.high = high

    def extract(self, image: UInt8[np.ndarray, "height width"], limit: int | None = None) -> FeatureSet:
        """Return the ellipses of a picture, highest score first; see :meth:`FeatureExtractor.extract`."""
        edges = cv2.Canny(cv2.GaussianBlur(image, (0, 0), 1.0), self.low, self.high)
        chains, _ = cv2.findContours(edges, cv2.RETR_LIST, cv2.CHAIN_APPROX_NONE)
        found = [
            own for chain in chains if (own := _fitted(np.asarray(chain, np.float32)[:, 0], image.shape)) is not None
        ]
        distinct: list[tuple[float, Float[np.ndarray, " ends"]]] = []
        for score, ellipse in sorted(found, key=lambda own: (-own[0], *own[1])):
            if len(distinct) == limit:
                break
            if all(np.abs(_extent(ellipse) - _extent(other)).max() > SAME_PX for _, other in distinct):
                distinct.append((score, ellipse))
        if not distinct:
            return FeatureSet.empty(self.node_type, self.descriptor_dim)
        geometry = np.array([ellipse for _, ellipse in distinct], np.float32)
        centers = geometry.reshape(-1, 4, 2).mean(axis=1)
        radii = np.linalg.norm(geometry[:, :2] - geometry[:, 2:4], axis=1) / 2
        orientation_px = np.stack([radii, np.zeros(len(radii))], axis=1).astype(np.float32)
        return FeatureSet(
            self.node_type,
            _described(image, centers, radii),
            geometry,
            np.array([score for score, _ in distinct], np.float32),
            orientation_px,
        )


def _fitted(
    chain: Float32[np.ndarray, "p 2"], shape: tuple[int, ...]
) -> tuple[float, Float[np.ndarray, " ends"]] | None:
    """Return the score and the ellipse of a chain of edge pixels, or None when it shows none."""
    if len(chain) < 6 * MIN_SEMI_AXIS_PX:
        return None
    kept = chain
    for _ in range(FITS):
        (x, y), axes, degrees = cv2.fitEllipseAMS(kept)
        minor, major = np.sort(np.array(axes) / 2)
        usable = np.isfinite([x, y, *axes]).all() and minor >= max(MIN_SEMI_AXIS_PX, MIN_AXIS_RATIO * major)
        if not usable or major > max(shape):
            return None
        first, second = axes[0] / 2, axes[1] / 2
        angle = np.radians(degrees)
        ellipse = ellipse_of_axes((x, y), (first, second), angle)
        rows = torch.from_numpy(ellipse)[None].expand(len(chain), -1)
        distances = point_to_ellipse(torch.from_numpy(chain).double(), rows)[:, 0].abs().numpy()
        on_it = distances <= max(2 * MAX_RESIDUAL_PX, 2 * float(np.median(distances)))
        kept = chain[on_it]  # without the edge of what covers a part of it
    on_it = distances <= 2 * MAX_RESIDUAL_PX
    residual = float(np.median(distances[on_it])) if on_it.any() else np.inf
    if on_it.mean() < MIN_INLIERS or residual > min(MAX_RESIDUAL_PX, MAX_RESIDUAL_SHARE * minor):
        return None
    # In the frame in which the ellipse is a circle.
    cosine, sine = np.cos(angle), np.sin(angle)
    offset = (chain[on_it] - [x, y]) @ np.array([[cosine, -sine], [sine, cosine]]) / [first, second]
    sectors = np.floor((np.arctan2(offset[:, 1], offset[:, 0]) / (2 * np.pi) % 1.0) * SECTORS).astype(np.int64)
    cover = len(np.unique(sectors % SECTORS)) / SECTORS
    return (float(cover * np.sqrt(first * second)), ellipse) if cover >= MIN_COVER else None


def _extent(ellipse: Float[np.ndarray, " ends"]) -> Float[np.ndarray, " four"]:
    """Return center and half width and height, which do not depend on the order of the ends."""
    points = ellipse.reshape(4, 2)
    arms = np.stack([points[0] - points[1], points[2] - points[3]]) / 2
    return np.concatenate([points.mean(axis=0), np.sqrt((arms**2).sum(axis=0))])


def _described(
    image: UInt8[np.ndarray, "height width"], centers: Float32[np.ndarray, "n 2"], radii: Float32[np.ndarray, " n"]
) -> Float32[np.ndarray, "n 128"]:
    """Return upright SIFT descriptors of the regions that ellipses surround; of no direction where they are plain."""
    keypoints = [
        cv2.KeyPoint(float(x), float(y), float(PATCH_SHARE * radius), 0.0)
        for (x, y), radius in zip(centers, radii, strict=True)
    ]
    for number, keypoint in enumerate(keypoints):
        keypoint.class_id = number
    kept, histograms = sift_detector(0.01).compute(image, keypoints)
    descriptors = np.ones((len(centers), 128), np.float32)
    for keypoint, histogram in zip(kept, np.asarray(histograms, np.float32).reshape(-1, 128), strict=True):
        if histogram.any():
            descriptors[keypoint.class_id] = histogram
    return np.asarray(descriptors / np.linalg.norm(descriptors, axis=1, keepdims=True), np.float32)
