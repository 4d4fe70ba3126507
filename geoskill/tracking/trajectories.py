"""Long-range trajectories: each feature's position at past anchor frames and at the last frame.

::

    frame   0 . . . . s . . . . t . . . . last
                      G <~~~~ F ---------> F'     F' by optical flow alone
            H <~~~~~~ G                           a similar feature of an earlier frame, where the flow from F ends,
                                                  is identified with F, and so on

Backward flow alone is misleading: a feature that was hidden earlier sticks to whatever was at its position, and a
feature of the object that sticks to the goal seems to have always been there. An earlier position therefore counts only
if a similar feature was detected there; such links are chained from frame to frame. In forward direction the error is
harmless: a feature that is lost drifts away from its counterpart, and earns no reward.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import final

import numpy as np
import torch
from jaxtyping import Bool, Float32, Int64

from geoskill.features.feature_set import FeatureSet
from geoskill.geometry.outlines import distance_to_outline
from geoskill.geometry.primitives import NodeType, centers
from geoskill.geometry.segments import distance_to_segment
from geoskill.tracking.flow import Flow, track_dense
from geoskill.tracking.motion import Part, Trajectory
from geoskill.tracking.tracks import tracks_to_end
from geoskill.tuning import TrajectoryConfig


def trajectories(
    features: Sequence[FeatureSet],
    flows: Sequence[Flow],
    hop: int,
    shorter_side: int,
    config: TrajectoryConfig | None = None,
) -> list[Trajectory]:
    """Compute the trajectories of every frame's features.

    Args:
        features: of every frame, all of one type.
        flows: from each frame ``t`` to ``t + hop``.
        hop: number of frames from the first to the second frame of a flow.
        shorter_side: of the frames, in pixels.
        config: anchors and thresholds; None for the defaults.
    """
    config = TrajectoryConfig() if config is None else config
    pasts = _pasts(features, flows, hop, shorter_side, config)
    finals = _final_positions(features, flows, hop, config.rest_px)
    return [
        Trajectory(
            torch.from_numpy(past.anchor_xy),
            torch.from_numpy(past.first_known_anchor),
            torch.from_numpy(final_xy),
            torch.from_numpy(final_known),
            part=torch.full((len(final_known),), Part.UNKNOWN),
        )
        for past, (final_xy, final_known) in zip(pasts, finals, strict=True)
    ]


@final
@dataclass(frozen=True, eq=False)
class _Past:
    """The past of one frame's features; see :class:`~geoskill.tracking.motion.Trajectory`."""

    anchor_xy: Float32[np.ndarray, "n a g"]
    first_known_anchor: Int64[np.ndarray, " n"]


def _pasts(
    features: Sequence[FeatureSet], flows: Sequence[Flow], hop: int, shorter_side: int, config: TrajectoryConfig
) -> list[_Past]:
    anchors = np.linspace(0, len(features) - 1, config.anchors).round().astype(np.int64)
    tolerance_px = config.position_tolerance_ratio * shorter_side
    max_difference = _max_descriptor_difference(features, config.similarity_ratio)
    pasts: list[_Past] = []
    for t, own in enumerate(features):
        # In whole hops back from t, each anchor is read at the last frame not before it.
        hops_to = np.where(anchors <= t, (t - anchors) // hop, -1)
        anchor_xy = np.repeat(own.geometry[:, None], len(anchors), axis=1)
        known = np.repeat((hops_to == 0)[None], len(own), axis=0)
        geometry, unlinked = own.geometry.copy(), np.ones(len(own), bool)
        flow_path = [own.geometry]
        for hops in range(1, min(t // hop, config.max_gap_hops) + 1):
            rows = np.flatnonzero(unlinked)
            if len(rows) == 0:
                break
            earlier = t - hops * hop
            geometry[rows], unlinked[rows] = track_dense(own.node_type, geometry[rows], flows[earlier].reversed())
            rows = rows[unlinked[rows]]
            match = _similar_and_near(own, rows, geometry, features[earlier], max_difference, tolerance_px)
            linked, match = rows[match >= 0], match[match >= 0]
            for anchor, hops_back in enumerate(hops_to):
                if 0 <= hops_back < hops:
                    anchor_xy[linked, anchor] = flow_path[hops_back][linked]
                    known[linked, anchor] = True
                elif hops_back >= hops:
                    anchor_xy[linked, anchor] = pasts[earlier].anchor_xy[match, anchor]
                    known[linked, anchor] = pasts[earlier].first_known_anchor[match] <= anchor
            unlinked[linked] = False
            flow_path.append(geometry.copy())
        first_known_anchor = np.where(known.any(axis=1), known.argmax(axis=1), len(anchors))
        pasts.append(_Past(anchor_xy, first_known_anchor.astype(np.int64)))
    return pasts


def _max_descriptor_difference(features: Sequence[FeatureSet], similarity_ratio: float) -> float:
    """Return the largest difference of similar descriptors, from the differences of neighbors within each frame."""
    differences = np.concatenate(
        [np.linalg.norm(detected.descriptors[1:] - detected.descriptors[:-1], axis=1) for detected in features]
    )
    return similarity_ratio * float(np.median(differences)) if len(differences) else 0.0


def _similar_and_near(
    own: FeatureSet,
    rows: Int64[np.ndarray, " r"],
    tracked_geometry: Float32[np.ndarray, "n g"],
    earlier: FeatureSet,
    max_difference: float,
    tolerance_px: float,
) -> Int64[np.ndarray, " r"]:
    """Return for each of the rows the most similar feature of the earlier frame near its tracked position, or -1."""
    if len(rows) == 0 or len(earlier) == 0:
        return np.full(len(rows), -1)
    difference = np.linalg.norm(own.descriptors[rows][:, None] - earlier.descriptors[None], axis=2)
    near = _distances(own.node_type, tracked_geometry[rows], earlier.geometry) <= tolerance_px
    difference = np.where(near, difference, np.inf)
    best = difference.argmin(axis=1)
    return np.where(difference[np.arange(len(rows)), best] <= max_difference, best, -1)


def _distances(
    node_type: NodeType, tracked: Float32[np.ndarray, "r g"], detected: Float32[np.ndarray, "n g"]
) -> Float32[np.ndarray, "r n"]:
    """Return distances between points, or from the midpoints of tracked segments to detected ones.

    The ends of a segment vary from frame to frame, and so does its midpoint along the line. So does the outline of a
    plane, which ends where something covers it, or where another surface comes into the plane: each of two has to
    reach the center of the other.
    """
    positions = centers(tracked)[:, None]
    if node_type is NodeType.LINE:
        return distance_to_segment(positions, detected[None])
    if node_type is NodeType.PLANE:
        own, other = (distance_to_outline(centers(one), two) for one, two in ((tracked, detected), (detected, tracked)))
        return np.asarray(np.maximum(own, other.T))
    distances: np.ndarray = np.linalg.norm(positions - centers(detected)[None], axis=2)
    return distances


def _final_positions(
    features: Sequence[FeatureSet], flows: Sequence[Flow], hop: int, rest_px: float
) -> list[tuple[Float32[np.ndarray, "n g"], Bool[np.ndarray, " n"]]]:
    """Return each frame's features at the end, and whether their position there is known."""
    finals: list[tuple[np.ndarray, np.ndarray]] = []
    for track in tracks_to_end(features, flows, hop):
        own = features[track.start].geometry
        offsets = (track.geometry - own).reshape(len(own), own.shape[1] // 2, 2)
        distance = np.linalg.norm(offsets, axis=2).max(axis=1, initial=0.0)
        at_rest = ~track.tracked & (distance <= rest_px)
        finals.append((np.where(track.tracked[:, None], track.geometry, own), track.tracked | at_rest))
    return finals
