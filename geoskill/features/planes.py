"""Planes of a picture with depth: regions of pixels whose points lie in one plane.

Found one after the other by RANSAC ("Random sample consensus", Fischler and Bolles, 1981) on every fourth pixel. Of the
points on a plane the largest connected region counts, so that two surfaces in one plane are two features; but where
they touch, as a box that is laid flush against a plate, they are one.
"""

from typing import ClassVar, Final, final

import cv2
import numpy as np
from jaxtyping import Bool, Float32, Float64, UInt8

from geoskill.features.extractor import FeatureExtractor
from geoskill.features.feature_set import FeatureSet
from geoskill.features.lifting import INDEPENDENT_PX2, INLIER_STD, MIN_EXACT_M, fitted_plane
from geoskill.features.sift import Sift
from geoskill.geometry.depth_picture import DepthPicture
from geoskill.geometry.primitives import NodeType

STRIDE: Final = 4
"""Every so many pixels, along rows and columns, is looked at."""
MIN_PIXELS: Final = 400
MAX_PLANES: Final = 6
MAX_POINTS: Final = 300
"""Points of the picture whose descriptors are averaged, the strongest."""
DRAWS: Final = 64
REACH: Final = 12
"""The three points of a draw are at most so many looked-at pixels apart, along rows and columns."""
MIN_INNER: Final = 12
"""A plane is fitted to the looked-at pixels within its rim where there are so many."""
ROUNDS: Final = 4
"""Fits of a plane, each to the region of the one before: the one that is drawn is tilted, and so cuts off a part."""


@final
class Planes(FeatureExtractor):
    """Planes of at least 400 pixels, the largest first, at most six; without depth there are none.

    The descriptor is the mean of the SIFT descriptors on the plane; one without any has that of no direction.
    """

    name: ClassVar[str] = "planes"
    node_type: ClassVar[NodeType] = NodeType.PLANE
    descriptor_dim: ClassVar[int] = 128
    has_orientation: ClassVar[bool] = True
    needs_depth: ClassVar[bool] = True

    def extract(self, image: UInt8[np.ndarray, "height width"], limit: int | None = None) -> FeatureSet:
        """Return no feature; see :meth:`extract_in_depth`."""
        return FeatureSet.empty(self.node_type, self.descriptor_dim)

    def extract_in_depth(
        self, image: UInt8[np.ndarray, "height width"], depth: DepthPicture, limit: int | None = None
    ) -> FeatureSet:
        """Return the planes of a picture with depth; see :meth:`FeatureExtractor.extract_in_depth`."""
        count = MAX_PLANES if limit is None else min(limit, MAX_PLANES)
        found = find_planes(depth)[:count]
        if not found:
            return self.extract(image)
        points = Sift().extract(image, MAX_POINTS)
        columns, rows = np.round(points.geometry / STRIDE).astype(np.int64).T
        descriptors, outlines, orientations = [], [], []
        for mask, _, _ in found:
            inside = mask[rows.clip(0, mask.shape[0] - 1), columns.clip(0, mask.shape[1] - 1)]
            mean = points.descriptors[inside].sum(axis=0) if inside.any() else np.ones(self.descriptor_dim)
            descriptors.append(mean / np.linalg.norm(mean))
            corners = _outline(mask)
            outlines.append(corners.ravel())
            sides = [corners[1] - corners[0], corners[2] - corners[1]]
            orientations.append(min(sides, key=lambda side: float(np.linalg.norm(side))) / 2)
        return FeatureSet(
            self.node_type,
            np.array(descriptors, np.float32),
            np.array(outlines, np.float32),
            np.array([STRIDE**2 * mask.sum() for mask, _, _ in found], np.float32),
            np.array(orientations, np.float32),
            np.array([plane for _, plane, _ in found], np.float32),
            np.array([covariance for _, _, covariance in found], np.float32),
        )


Region = tuple[Bool[np.ndarray, "rows columns"], Float64[np.ndarray, "4"], Float64[np.ndarray, "4 4"]]
"""Which of the looked-at pixels show a plane, its ``[n, d]`` in meters, and the covariance of that."""


def find_planes(depth: DepthPicture, count: int = MAX_PLANES) -> list[Region]:
    """Return the planes of a picture of depth, the largest first; the same ones at every call."""
    random = np.random.default_rng(0)
    depths = depth.depth_m[::STRIDE, ::STRIDE].astype(np.float64)
    rows, columns = np.mgrid[: depths.shape[0], : depths.shape[1]]
    points = depth.camera.back_project(STRIDE * np.stack([columns, rows], axis=-1).astype(np.float64), depths)
    tolerance = INLIER_STD * depth.camera.depth_std_m(depths) + MIN_EXACT_M
    free = np.isfinite(depths)
    found: list[Region] = []
    misses = 0
    while len(found) < count and misses < 2 and STRIDE**2 * free.sum() >= MIN_PIXELS:
        drawn = _drawn(points, free, tolerance, random)
        own = None if drawn is None else _grown(points, free, tolerance, drawn, depth)
        if own is None:
            misses += 1
            continue
        found.append(own)
        free &= ~own[0]
    return sorted(found, key=lambda own: -int(own[0].sum()))


def _drawn(
    points: Float64[np.ndarray, "rows columns 3"],
    free: Bool[np.ndarray, "rows columns"],
    tolerance: Float64[np.ndarray, "rows columns"],
    random: np.random.Generator,
) -> Float64[np.ndarray, "4"] | None:
    """Return of some planes through three near points the one that most points are on."""
    rows, columns = np.nonzero(free)
    first = random.integers(len(rows), size=DRAWS)
    corners = [points[rows[first], columns[first]]]
    for _ in range(2):
        near = [
            (places[first] + random.integers(-REACH, REACH + 1, DRAWS)).clip(0, size - 1)
            for places, size in ((rows, free.shape[0]), (columns, free.shape[1]))
        ]
        corners.append(np.where(free[near[0], near[1]][:, None], points[near[0], near[1]], np.nan))
    normals = np.cross(corners[1] - corners[0], corners[2] - corners[0])
    with np.errstate(invalid="ignore"):
        lengths = np.linalg.norm(normals, axis=1)
        usable = lengths > 0
    normals, places = normals[usable] / lengths[usable, None], corners[0][usable]
    if len(normals) == 0:
        return None
    offsets = -(normals * places).sum(axis=1)
    known, limits = points[free], tolerance[free]
    support = (np.abs(known @ normals.T + offsets) <= limits[:, None]).sum(axis=0)
    best = int(support.argmax())
    return np.append(normals[best], offsets[best])


def _grown(
    points: Float64[np.ndarray, "rows columns 3"],
    free: Bool[np.ndarray, "rows columns"],
    tolerance: Float64[np.ndarray, "rows columns"],
    drawn: Float64[np.ndarray, "4"],
    depth: DepthPicture,
) -> Region | None:
    """Return the region of a drawn plane, fitted to its points again and again, or None when it is too small."""
    plane, covariance = drawn, np.zeros((4, 4))
    region = _region(points, free, tolerance, plane)
    for _ in range(ROUNDS):
        if region is None:
            return None
        inner = points[_inner(region)]
        plane, covariance = fitted_plane(inner, depth, independent=STRIDE**2 / INDEPENDENT_PX2)
        region = _region(points, free, tolerance, plane)
    return None if region is None else (region, plane, covariance)


def _region(
    points: Float64[np.ndarray, "rows columns 3"],
    free: Bool[np.ndarray, "rows columns"],
    tolerance: Float64[np.ndarray, "rows columns"],
    plane: Float64[np.ndarray, "4"],
) -> Bool[np.ndarray, "rows columns"] | None:
    """Return the largest connected region of the points on a plane, or None when it is too small."""
    with np.errstate(invalid="ignore"):
        near = free & (np.abs(points @ plane[:3] + plane[3]) <= tolerance)
    count, labels, statistics, _ = cv2.connectedComponentsWithStats(near.astype(np.uint8), connectivity=4)
    if count < 2:
        return None
    largest = 1 + int(np.asarray(statistics)[1:, cv2.CC_STAT_AREA].argmax())
    region: np.ndarray = np.asarray(labels) == largest
    return region if STRIDE**2 * region.sum() >= MIN_PIXELS else None


def _inner(region: Bool[np.ndarray, "rows columns"]) -> Bool[np.ndarray, "rows columns"]:
    """Return a region without its rim, where the side of a thing may be within the tolerance; all of a small one."""
    inner: np.ndarray = cv2.erode(region.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
    return inner if inner.sum() >= MIN_INNER else region


def _outline(mask: Bool[np.ndarray, "rows columns"]) -> Float32[np.ndarray, "4 2"]:
    """Return the corners of the smallest box around a region, in pixels of the picture."""
    rows, columns = np.nonzero(mask)
    box = cv2.minAreaRect(STRIDE * np.stack([columns, rows], axis=1).astype(np.float32))
    return np.asarray(cv2.boxPoints(box), np.float32)
