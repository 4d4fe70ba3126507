"""Tracking of features from one frame to another by optical flow.

Dense flow (DIS, Kroeger et al., ECCV 2016) is used for training: its cost does not grow with the number of features,
and it serves as well as sparse flow (docs/experiments/demonstrations.md). Sparse flow (Lucas and Kanade, on a pyramid)
is used for the few features that a skill has selected. Both apply the forward-backward check: a point counts as tracked
when the backward flow returns it to where it started ("Forward-backward error", Kalal et al., ICPR 2010). Dense flow
without a backward one, for half the cost, only loses what leaves the frame.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import final

import cv2
import numpy as np
from jaxtyping import Bool, Float32, UInt8

from geoskill.geometry.primitives import NodeType
from geoskill.geometry.sampling import resized, sample_bilinear

# Points tracked on a segment, from end to end; more than half of them must be tracked.
SAMPLES_PER_SEGMENT = 7
# Points tracked within the outline of a plane, along either side, and on an ellipse; likewise.
OUTLINE_SIDE = 5
SAMPLES_PER_CONIC = 16
# Largest distance in pixels between a point and its return.
TOLERANCE_PX = 1.0
# Larger pictures are reduced to this shorter side; the flow is accurate to a fraction of a reduced pixel.
WORKING_SIDE = 480
# The coarsest level of the flow's pyramid must hold several of its 8-pixel patches.
MIN_SIDE = 32


@final
@dataclass(frozen=True, eq=False)
class Flow:
    """Displacements of the pixels of one frame to another, and back.

    Attributes:
        forward: displacements in pixels of the working size.
        backward: from the second frame to the first; None for a flow without the forward-backward check.
        scale: working size divided by frame size.
    """

    forward: Float32[np.ndarray, "height width 2"]
    backward: Float32[np.ndarray, "height width 2"] | None
    scale: float

    def reversed(self) -> "Flow":
        """Return the flow from the second frame to the first.

        Raises:
            ValueError: when there is no backward flow.
        """
        if self.backward is None:
            raise ValueError("the flow has no backward one; expected one computed with it")
        return Flow(self.backward, self.forward, self.scale)


def dense_flow(start: UInt8[np.ndarray, "height width 3"], end: UInt8[np.ndarray, "height width 3"]) -> Flow:
    """Compute the flow between two RGB frames of the same size."""
    return gray_flow(cv2.cvtColor(start, cv2.COLOR_RGB2GRAY), cv2.cvtColor(end, cv2.COLOR_RGB2GRAY))


def gray_flow(
    start: UInt8[np.ndarray, "height width"],
    end: UInt8[np.ndarray, "height width"],
    preset: int = cv2.DISOPTICAL_FLOW_PRESET_MEDIUM,
    *,
    with_backward: bool = True,
) -> Flow:
    """Compute the flow between two gray frames of the same size.

    Args:
        start: first frame.
        end: second frame.
        preset: OpenCV's preset for DIS, a trade-off between speed and accuracy.
        with_backward: compute the backward flow, too, which takes as long again.
    """
    scale = min(1.0, WORKING_SIDE / min(start.shape))
    small = [resized(frame, scale) for frame in (start, end)]
    height, width = small[0].shape
    if min(height, width) < MIN_SIDE:
        margins = (0, max(0, MIN_SIDE - height), 0, max(0, MIN_SIDE - width))
        small = [np.asarray(cv2.copyMakeBorder(picture, *margins, cv2.BORDER_REPLICATE), np.uint8) for picture in small]
    estimator = cv2.DISOpticalFlow.create(preset)
    first, second = small

    def displacements(start: np.ndarray, end: np.ndarray) -> Float32[np.ndarray, "_ _ 2"]:
        whole = np.asarray(estimator.calc(start, end, None), np.float32)  # type: ignore[call-overload]
        return whole[:height, :width]

    return Flow(displacements(first, second), displacements(second, first) if with_backward else None, scale)


def track_between(
    node_type: NodeType,
    geometry: Float32[np.ndarray, "n g"],
    start: UInt8[np.ndarray, "height width 3"],
    end: UInt8[np.ndarray, "height width 3"],
    *,
    tolerance_px: float = TOLERANCE_PX,
) -> tuple[Float32[np.ndarray, "n g"], Bool[np.ndarray, " n"]]:
    """Track features between two RGB frames by dense flow; see :func:`track_dense`."""
    if len(geometry) == 0:
        return geometry.copy(), np.zeros(0, bool)
    return track_dense(node_type, geometry, dense_flow(start, end), tolerance_px=tolerance_px)


def track_dense(
    node_type: NodeType, geometry: Float32[np.ndarray, "n g"], flow: Flow, *, tolerance_px: float = TOLERANCE_PX
) -> tuple[Float32[np.ndarray, "n g"], Bool[np.ndarray, " n"]]:
    """Track features from the first frame of a flow to the second.

    Args:
        node_type: type of the features.
        geometry: points or segments in pixels of the first frame.
        flow: between the frames.
        tolerance_px: largest distance between a point and its return; not used without a backward flow.

    Returns:
        The geometry in the second frame (unchanged where a feature was lost) and a mask of the tracked features. A
        segment counts as tracked when most of its sample points do; it moves rigidly, so its length is kept. Its
        displacement along itself is uncertain (aperture problem). Flow is smooth: a feature that vanishes in a plain
        region, or lies within some pixels of the edge of a moving object, may count as tracked.
    """
    return _track(node_type, geometry, lambda points: _track_points_dense(points, flow, tolerance_px))


def track_sparse(
    node_type: NodeType,
    geometry: Float32[np.ndarray, "n g"],
    start: UInt8[np.ndarray, "height width"],
    end: UInt8[np.ndarray, "height width"],
    *,
    tolerance_px: float = TOLERANCE_PX,
) -> tuple[Float32[np.ndarray, "n g"], Bool[np.ndarray, " n"]]:
    """Track a few features between two gray frames by sparse flow, which is cheaper than dense flow for few features.

    Arguments and results are those of :func:`track_dense`. A textured object that moves past a feature may drag it
    along. In frames smaller than :data:`MIN_SIDE` every feature is lost.
    """
    if min(start.shape) < MIN_SIDE:
        return geometry.copy(), np.zeros(len(geometry), bool)

    def track_points(points: Float32[np.ndarray, "p 2"]) -> tuple[np.ndarray, np.ndarray]:
        moved, consistent = lucas_kanade(points, start, end, tolerance_px)
        height, width = start.shape
        inside = (moved >= -0.5).all(axis=1) & (moved <= (width - 0.5, height - 0.5)).all(axis=1)
        return moved, inside & consistent

    return _track(node_type, geometry, track_points)


def lucas_kanade(
    points: Float32[np.ndarray, "n 2"],
    start: UInt8[np.ndarray, "height width"],
    end: UInt8[np.ndarray, "height width"],
    tolerance_px: float = TOLERANCE_PX,
) -> tuple[Float32[np.ndarray, "n 2"], Bool[np.ndarray, " n"]]:
    """Track points between two gray frames by Lucas and Kanade's flow on a pyramid, with the forward-backward check.

    Returns:
        The points in the second frame, and a mask of those that were found there and whose backward flow ends no
        farther than ``tolerance_px`` from the start. Points may lie outside the frame.
    """
    source = np.ascontiguousarray(points, np.float32)[:, None]
    track = cv2.calcOpticalFlowPyrLK
    moved, forward_found, _ = (np.asarray(result) for result in track(start, end, source, None))  # type: ignore[call-overload]
    returned, backward_found, _ = (np.asarray(result) for result in track(end, start, moved, None))  # type: ignore[call-overload]
    close = np.linalg.norm((returned - source)[:, 0], axis=1) <= tolerance_px
    consistent = close & (forward_found[:, 0] > 0) & (backward_found[:, 0] > 0)
    return np.asarray(moved[:, 0], np.float32), consistent


def _track(
    node_type: NodeType,
    geometry: Float32[np.ndarray, "n g"],
    track_points: Callable[[Float32[np.ndarray, "p 2"]], tuple[np.ndarray, np.ndarray]],
) -> tuple[Float32[np.ndarray, "n g"], Bool[np.ndarray, " n"]]:
    """Track features of any type by a function that tracks points."""
    if len(geometry) == 0:
        return geometry.copy(), np.zeros(0, bool)
    if node_type is NodeType.POINT:
        moved, tracked = track_points(geometry)
        return np.where(tracked[:, None], moved, geometry), tracked
    ends = geometry.reshape(len(geometry), -1, 2)
    samples = np.einsum("se,nex->nsx", _sample_weights(node_type), ends).astype(np.float32)
    moved, tracked = track_points(samples.reshape(-1, 2))
    return _refit_segments(ends, samples, moved.reshape(samples.shape), tracked.reshape(samples.shape[:2]))


def _track_points_dense(
    points: Float32[np.ndarray, "n 2"], flow: Flow, tolerance_px: float
) -> tuple[Float32[np.ndarray, "n 2"], Bool[np.ndarray, " n"]]:
    # A resize keeps the edges of pixels, not their centers, in place.
    source = (points + 0.5) * flow.scale - 0.5
    moved = source + sample_bilinear(flow.forward, source)
    height, width = flow.forward.shape[:2]
    inside = (moved >= -0.5).all(axis=1) & (moved[:, 0] <= width - 0.5) & (moved[:, 1] <= height - 0.5)
    tracked = inside
    if flow.backward is not None:
        returned = moved + sample_bilinear(flow.backward, moved)
        tracked = inside & (np.linalg.norm(returned - source, axis=1) <= tolerance_px * flow.scale)
    return ((moved + 0.5) / flow.scale - 0.5).astype(np.float32), tracked


def _refit_segments(
    ends: Float32[np.ndarray, "n e 2"],
    samples: Float32[np.ndarray, "n s 2"],
    moved: Float32[np.ndarray, "n s 2"],
    tracked: Bool[np.ndarray, "n s"],
) -> tuple[Float32[np.ndarray, "n g"], Bool[np.ndarray, " n"]]:
    """Apply to each feature the rigid motion (rotation and shift, least squares) of its tracked samples."""
    weight = tracked.astype(np.float32)
    total = weight.sum(axis=1)
    enough = total >= samples.shape[1] // 2 + 1
    share = (weight / np.maximum(total, 1.0)[:, None])[:, :, None]
    center_before, center_after = (samples * share).sum(axis=1), (moved * share).sum(axis=1)
    before, after = samples - center_before[:, None], moved - center_after[:, None]
    cosine = (share[:, :, 0] * (before * after).sum(axis=2)).sum(axis=1)
    sine = (share[:, :, 0] * (before[:, :, 0] * after[:, :, 1] - before[:, :, 1] * after[:, :, 0])).sum(axis=1)
    angle = np.arctan2(sine, cosine)
    rotation = np.stack([np.cos(angle), -np.sin(angle), np.sin(angle), np.cos(angle)], axis=1).reshape(-1, 2, 2)
    shifted = np.einsum("nij,nkj->nki", rotation, ends - center_before[:, None]) + center_after[:, None]
    geometry = np.where(enough[:, None, None], shifted, ends).reshape(len(ends), -1).astype(np.float32)
    return geometry, enough


def _sample_weights(node_type: NodeType) -> Float32[np.ndarray, "s e"]:
    """Return the points that are tracked on a feature, as weights of the points that it is made of."""
    if node_type is NodeType.LINE:
        share = np.linspace(0.0, 1.0, SAMPLES_PER_SEGMENT)
        weights = np.stack([1 - share, share], axis=1)
    elif node_type is NodeType.PLANE:  # inside of its outline, which holds others too
        x, y = (own.ravel() for own in np.meshgrid(*[np.linspace(0.2, 0.8, OUTLINE_SIDE)] * 2))
        weights = np.stack([(1 - x) * (1 - y), x * (1 - y), x * y, (1 - x) * y], axis=1)
    else:  # on an ellipse: center + cos u + sin v, with u and v half the diameters
        angle = np.arange(SAMPLES_PER_CONIC) * (2 * np.pi / SAMPLES_PER_CONIC)
        u, v = np.cos(angle) / 2, np.sin(angle) / 2
        weights = 0.25 + np.stack([u, -u, v, -v], axis=1)
    return weights.astype(np.float32)
