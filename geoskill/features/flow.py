"""Following features from one frame to another by sparse optical flow. Used in training only.

Lucas and Kanade's pyramidal tracker (Bouguet's version, in OpenCV), forwards and backwards: a feature counts as
followed when it returns to where it started ("Forward-backward error", Kalal et al., ICPR 2010).
"""

import cv2
import numpy as np
from jaxtyping import Bool, Float32, UInt8

from geoskill.geometry.primitives import NodeType

# Points of a segment that are followed, from one end point to the other. Five or more tell a bent track from a straight
# one; each costs as much as a point feature.
SAMPLES_PER_SEGMENT = 7


def follow_features(
    node_type: NodeType,
    geometry: Float32[np.ndarray, "n g"],
    start: UInt8[np.ndarray, "height width 3"],
    end: UInt8[np.ndarray, "height width 3"],
    *,
    window: int = 15,
    tolerance_px: float = 1.0,
) -> tuple[Float32[np.ndarray, "n g"], Bool[np.ndarray, " n"]]:
    """Where features of frame ``start`` lie in frame ``end``, and which of them could be followed.

    Args:
        node_type: what the features are.
        geometry: points or segments of ``start`` in pixels.
        start: RGB frame the features come from.
        end: RGB frame to find them in.
        window: side of the tracker's window in pixels.
        tolerance_px: largest distance between a point and its return.

    Returns:
        The moved geometry (equal to the old one where a feature was lost) and a mask of the followed ones. A segment is
        followed when most of its sample points are. Motion of a segment along itself is what its texture shows and thus
        uncertain (the aperture problem); its length is kept.
    """
    if len(geometry) == 0:
        return geometry.copy(), np.zeros(0, bool)
    grey_start, grey_end = (cv2.cvtColor(frame, cv2.COLOR_RGB2GRAY) for frame in (start, end))
    if node_type is NodeType.POINT:
        moved, followed = _follow_points(geometry, grey_start, grey_end, window, tolerance_px)
        return np.where(followed[:, None], moved, geometry), followed
    ends = geometry.reshape(-1, 2, 2)
    share = np.linspace(0.0, 1.0, SAMPLES_PER_SEGMENT, dtype=np.float32)[None, :, None]
    samples = ends[:, :1] + share * (ends[:, 1:] - ends[:, :1])
    moved, followed = _follow_points(samples.reshape(-1, 2), grey_start, grey_end, window, tolerance_px)
    return _refit_segments(ends, samples, moved.reshape(samples.shape), followed.reshape(samples.shape[:2]))


def _follow_points(
    points: Float32[np.ndarray, "n 2"],
    start: UInt8[np.ndarray, "height width"],
    end: UInt8[np.ndarray, "height width"],
    window: int,
    tolerance_px: float,
) -> tuple[Float32[np.ndarray, "n 2"], Bool[np.ndarray, " n"]]:
    size = (window, window)
    source = np.ascontiguousarray(points, np.float32).reshape(-1, 1, 2)
    moved, forward, _ = map(np.asarray, cv2.calcOpticalFlowPyrLK(start, end, source, None, winSize=size))  # type: ignore[call-overload]
    returned, backward, _ = map(np.asarray, cv2.calcOpticalFlowPyrLK(end, start, moved, None, winSize=size))  # type: ignore[call-overload]
    distance = np.linalg.norm((returned - source).reshape(-1, 2), axis=1)
    followed = (forward.reshape(-1) == 1) & (backward.reshape(-1) == 1) & (distance <= tolerance_px)
    return moved.reshape(-1, 2), followed


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
    centre_before, centre_after = (samples * share).sum(axis=1), (moved * share).sum(axis=1)
    before, after = samples - centre_before[:, None], moved - centre_after[:, None]
    cosine = (share[:, :, 0] * (before * after).sum(axis=2)).sum(axis=1)
    sine = (share[:, :, 0] * (before[:, :, 0] * after[:, :, 1] - before[:, :, 1] * after[:, :, 0])).sum(axis=1)
    angle = np.arctan2(sine, cosine)
    rotation = np.stack([np.cos(angle), -np.sin(angle), np.sin(angle), np.cos(angle)], axis=1).reshape(-1, 2, 2)
    shifted = np.einsum("nij,nkj->nki", rotation, ends - centre_before[:, None]) + centre_after[:, None]
    geometry = np.where(enough[:, None, None], shifted, ends).reshape(-1, 4).astype(np.float32)
    return geometry, enough
