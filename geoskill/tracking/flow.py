"""Following features from one frame to another by optical flow.

For training and for scoring; a skill takes it to know again what it has selected, and what has moved as one.

The flow is dense (DIS, Kroeger et al., ECCV 2016): its cost does not grow with the number of features, and measured on
the real demonstration it serves as well as a sparse tracker of Lucas and Kanade's kind. A feature counts as followed
when the backward flow brings it back to where it started ("Forward-backward error", Kalal et al., ICPR 2010).
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import final

import cv2
import numpy as np
from jaxtyping import Bool, Float32, UInt8

from geoskill.geometry.primitives import NodeType

# Points of a segment that are followed, from one end point to the other; more than half of them must be found again.
SAMPLES_PER_SEGMENT = 7
# Largest distance in pixels between a point and its return.
TOLERANCE_PX = 1.0
# Larger pictures are followed at this shorter side; the flow is exact to a fraction of a pixel of the reduced picture.
WORKING_SIDE = 480
# The coarsest picture of the flow's pyramid must hold several of its 8-pixel patches.
SMALLEST_SIDE = 32


@final
@dataclass(frozen=True, eq=False)
class Flow:
    """Where the pixels of one frame lie in another, and back.

    Attributes:
        forward, backward: displacements in pixels of the working size.
        scale: working size over frame size.
    """

    forward: Float32[np.ndarray, "height width 2"]
    backward: Float32[np.ndarray, "height width 2"]
    scale: float

    def reversed(self) -> "Flow":
        """The same from the other frame's point of view."""
        return Flow(self.backward, self.forward, self.scale)


def dense_flow(start: UInt8[np.ndarray, "height width 3"], end: UInt8[np.ndarray, "height width 3"]) -> Flow:
    """The flow between two RGB frames of one size."""
    return gray_flow(cv2.cvtColor(start, cv2.COLOR_RGB2GRAY), cv2.cvtColor(end, cv2.COLOR_RGB2GRAY))


def gray_flow(
    start: UInt8[np.ndarray, "height width"],
    end: UInt8[np.ndarray, "height width"],
    preset: int = cv2.DISOPTICAL_FLOW_PRESET_MEDIUM,
) -> Flow:
    """The flow between two gray frames of one size, as thoroughly as one of OpenCV's presets of DIS."""
    height, width = start.shape
    scale = min(1.0, WORKING_SIDE / min(height, width))
    size = (max(1, round(width * scale)), max(1, round(height * scale)))
    small = [cv2.resize(frame, size, interpolation=cv2.INTER_AREA) for frame in (start, end)]
    if min(size) < SMALLEST_SIDE:
        margins = (0, max(0, SMALLEST_SIDE - size[1]), 0, max(0, SMALLEST_SIDE - size[0]))
        small = [cv2.copyMakeBorder(picture, *margins, cv2.BORDER_REPLICATE) for picture in small]
    estimator = cv2.DISOpticalFlow.create(preset)
    forward = np.asarray(estimator.calc(small[0], small[1], None), np.float32)  # type: ignore[call-overload]
    backward = np.asarray(estimator.calc(small[1], small[0], None), np.float32)  # type: ignore[call-overload]
    return Flow(forward[: size[1], : size[0]], backward[: size[1], : size[0]], scale)


def track_between(
    node_type: NodeType,
    geometry: Float32[np.ndarray, "n g"],
    start: UInt8[np.ndarray, "height width 3"],
    end: UInt8[np.ndarray, "height width 3"],
    *,
    tolerance_px: float = TOLERANCE_PX,
) -> tuple[Float32[np.ndarray, "n g"], Bool[np.ndarray, " n"]]:
    """:func:`track_dense` the flow between two RGB frames."""
    if len(geometry) == 0:
        return geometry.copy(), np.zeros(0, bool)
    return track_dense(node_type, geometry, dense_flow(start, end), tolerance_px=tolerance_px)


def track_dense(
    node_type: NodeType, geometry: Float32[np.ndarray, "n g"], flow: Flow, *, tolerance_px: float = TOLERANCE_PX
) -> tuple[Float32[np.ndarray, "n g"], Bool[np.ndarray, " n"]]:
    """Where features of a flow's first frame lie in its second, and which of them could be followed.

    Args:
        node_type: what the features are.
        geometry: points or segments in pixels of the frame.
        flow: from their frame to the other.
        tolerance_px: largest distance between a point and its return.

    Returns:
        The moved geometry (equal to the old one where a feature was lost) and a mask of the followed ones. A segment is
        followed when most of its sample points are. Displacement of a segment along itself is what its texture shows and thus
        uncertain (the aperture problem); its length is kept. Flow is smooth: what vanishes in a plain area, and what
        lies within some pixels of the edge of something that moves past, may count as followed.
    """
    return _follow(node_type, geometry, lambda points: _follow_points(points, flow, tolerance_px))


def track_sparse(
    node_type: NodeType,
    geometry: Float32[np.ndarray, "n g"],
    start: UInt8[np.ndarray, "height width"],
    end: UInt8[np.ndarray, "height width"],
    *,
    tolerance_px: float = TOLERANCE_PX,
) -> tuple[Float32[np.ndarray, "n g"], Bool[np.ndarray, " n"]]:
    """:func:`track_dense`, between two gray frames and for so few features that dense flow is not worth its time.

    The flow is that of Lucas and Kanade on a pyramid, at the features' own points. What something of texture moves past
    may be taken along by it. Frames smaller than :data:`SMALLEST_SIDE` are not followed through.
    """
    if min(start.shape) < SMALLEST_SIDE:
        return geometry.copy(), np.zeros(len(geometry), bool)
    return _follow(node_type, geometry, lambda points: _track_points(points, start, end, tolerance_px))


def _follow(
    node_type: NodeType,
    geometry: Float32[np.ndarray, "n g"],
    follow_points: Callable[[Float32[np.ndarray, "p 2"]], tuple[np.ndarray, np.ndarray]],
) -> tuple[Float32[np.ndarray, "n g"], Bool[np.ndarray, " n"]]:
    """Features of any type, by what follows points."""
    if len(geometry) == 0:
        return geometry.copy(), np.zeros(0, bool)
    if node_type is NodeType.POINT:
        moved, followed = follow_points(geometry)
        return np.where(followed[:, None], moved, geometry), followed
    ends = geometry.reshape(-1, 2, 2)
    share = np.linspace(0.0, 1.0, SAMPLES_PER_SEGMENT, dtype=np.float32)[None, :, None]
    samples = ends[:, :1] + share * (ends[:, 1:] - ends[:, :1])
    moved, followed = follow_points(samples.reshape(-1, 2))
    return _refit_segments(ends, samples, moved.reshape(samples.shape), followed.reshape(samples.shape[:2]))


def _track_points(
    points: Float32[np.ndarray, "n 2"],
    start: UInt8[np.ndarray, "height width"],
    end: UInt8[np.ndarray, "height width"],
    tolerance_px: float,
) -> tuple[Float32[np.ndarray, "n 2"], Bool[np.ndarray, " n"]]:
    source = np.ascontiguousarray(points, np.float32)[:, None]
    track = cv2.calcOpticalFlowPyrLK
    moved, there, _ = (np.asarray(each) for each in track(start, end, source, None))  # type: ignore[call-overload]
    returned, back, _ = (np.asarray(each) for each in track(end, start, moved, None))  # type: ignore[call-overload]
    height, width = start.shape
    inside = (moved[:, 0] >= -0.5).all(axis=1) & (moved[:, 0] <= (width - 0.5, height - 0.5)).all(axis=1)
    close = np.linalg.norm((returned - source)[:, 0], axis=1) <= tolerance_px
    return np.asarray(moved[:, 0], np.float32), inside & close & (there[:, 0] > 0) & (back[:, 0] > 0)


def _follow_points(
    points: Float32[np.ndarray, "n 2"], flow: Flow, tolerance_px: float
) -> tuple[Float32[np.ndarray, "n 2"], Bool[np.ndarray, " n"]]:
    # Pixel centers, not corners, keep their place when a picture is resized.
    source = (points + 0.5) * flow.scale - 0.5
    moved = source + _sample(flow.forward, source)
    returned = moved + _sample(flow.backward, moved)
    height, width = flow.forward.shape[:2]
    inside = (moved >= -0.5).all(axis=1) & (moved[:, 0] <= width - 0.5) & (moved[:, 1] <= height - 0.5)
    close = np.linalg.norm(returned - source, axis=1) <= tolerance_px * flow.scale
    return ((moved + 0.5) / flow.scale - 0.5).astype(np.float32), inside & close


def _sample(field: Float32[np.ndarray, "height width 2"], points: Float32[np.ndarray, "n 2"]) -> np.ndarray:
    """Bilinear values of a field; outside it, those of the border."""
    maps = np.ascontiguousarray(points, np.float32).reshape(1, -1, 2)
    # cv2.remap takes at most 32767 columns.
    parts = [
        cv2.remap(field, maps[:, i : i + 30000], None, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)  # type: ignore[call-overload]
        for i in range(0, maps.shape[1], 30000)
    ]
    values: np.ndarray = np.concatenate(parts, axis=1)[0]
    return values


def _refit_segments(
    ends: Float32[np.ndarray, "n 2 2"],
    samples: Float32[np.ndarray, "n s 2"],
    moved: Float32[np.ndarray, "n s 2"],
    followed: Bool[np.ndarray, "n s"],
) -> tuple[Float32[np.ndarray, "n 4"], Bool[np.ndarray, " n"]]:
    """The rigid motion (rotation and shift, least squares) of each segment's followed samples, applied to its ends."""
    weight = followed.astype(np.float32)
    total = weight.sum(axis=1)
    enough = total >= SAMPLES_PER_SEGMENT // 2 + 1
    share = (weight / np.maximum(total, 1.0)[:, None])[:, :, None]
    center_before, center_after = (samples * share).sum(axis=1), (moved * share).sum(axis=1)
    before, after = samples - center_before[:, None], moved - center_after[:, None]
    cosine = (share[:, :, 0] * (before * after).sum(axis=2)).sum(axis=1)
    sine = (share[:, :, 0] * (before[:, :, 0] * after[:, :, 1] - before[:, :, 1] * after[:, :, 0])).sum(axis=1)
    angle = np.arctan2(sine, cosine)
    rotation = np.stack([np.cos(angle), -np.sin(angle), np.sin(angle), np.cos(angle)], axis=1).reshape(-1, 2, 2)
    shifted = np.einsum("nij,nkj->nki", rotation, ends - center_before[:, None]) + center_after[:, None]
    geometry = np.where(enough[:, None, None], shifted, ends).reshape(-1, 4).astype(np.float32)
    return geometry, enough
