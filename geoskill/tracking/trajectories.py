"""Where every feature of a demonstration came from, and where it ends.

::

    frame   0 . . . . s . . . . t . . . . last
                      G <~~~~ F ---------> F'     F' by optical flow alone
            H <~~~~~~ G                           a feature of an earlier frame that looks like F and lies where the
                                                  flow leads back to is taken for F itself, and so on

Flow alone leads astray on the way back: what was hidden earlier sticks to whatever lay there, and a feature of the
object that sticks to the goal seems to have been there all the time. So an earlier place counts only where a feature
that looks alike was detected, and links of that kind are chained from frame to frame. On the way forward the error is
harmless: what is lost there separates from its like and earns nothing.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import final

import numpy as np
import torch
from jaxtyping import Bool, Float32, Int64

from geoskill.features.feature_set import FeatureSet
from geoskill.geometry.primitives import NodeType
from geoskill.tracking.flow import Flow, track_dense
from geoskill.tracking.motion import Trajectory
from geoskill.tracking.tracks import tracks_to_the_end

# Frames of the past at which places are kept, spread over the demonstration.
ANCHORS = 16
# A detection may lie this share of the shorter side from where the flow leads: some pixels, as detection and flow do.
PLACE_TOLERANCE = 0.01
# Two descriptors are alike when they differ by less than this share of the median distance between different features.
LIKENESS = 0.5
# Hops over which a feature may go undetected; one that did not show up again for so long is rarely found later.
LONGEST_GAP_HOPS = 32
# A feature that is lost, but has come no farther than this since, rests and was covered: it stays where it is.
REST_PX = 2.0


def trajectories(
    features: Sequence[FeatureSet], flows: Sequence[Flow], hop: int, shorter_side: int
) -> list[Trajectory]:
    """The trajectory of every frame's features.

    Args:
        features: of every frame, all of one type.
        flows: from frame ``t`` to ``t + hop``.
        hop: frames between the two of a flow.
        shorter_side: of the frames, in pixels.
    """
    pasts = _pasts(features, flows, hop, PLACE_TOLERANCE * shorter_side)
    ends = _ends(features, flows, hop)
    return [
        Trajectory(*map(torch.from_numpy, (past.places, past.since, *end)))
        for past, end in zip(pasts, ends, strict=True)
    ]


@final
@dataclass(frozen=True, eq=False)
class _Past:
    """Of one frame's features; see :class:`~geoskill.graphs.motif_graph.Trajectory`."""

    places: Float32[np.ndarray, "n a g"]
    since: Int64[np.ndarray, " n"]


def _pasts(features: Sequence[FeatureSet], flows: Sequence[Flow], hop: int, tolerance_px: float) -> list[_Past]:
    anchors = np.linspace(0, len(features) - 1, ANCHORS).round().astype(np.int64)
    likeness = _likeness(features)
    pasts: list[_Past] = []
    for t, own in enumerate(features):
        # Anchor a is looked up where the walk back from t in whole hops comes last before a.
        hops_to = np.where(anchors <= t, (t - anchors) // hop, -1)
        places = np.repeat(own.geometry[:, None], len(anchors), axis=1)
        known = np.repeat((hops_to == 0)[None], len(own), axis=0)
        geometry, waiting = own.geometry.copy(), np.ones(len(own), bool)
        way = [own.geometry]
        for hops in range(1, min(t // hop, LONGEST_GAP_HOPS) + 1):
            rows = np.flatnonzero(waiting)
            if len(rows) == 0:
                break
            earlier = t - hops * hop
            geometry[rows], waiting[rows] = track_dense(own.node_type, geometry[rows], flows[earlier].reversed())
            rows = rows[waiting[rows]]
            match = _alike_and_near(own, rows, geometry, features[earlier], likeness, tolerance_px)
            found, match = rows[match >= 0], match[match >= 0]
            for anchor, hops_back in enumerate(hops_to):
                if 0 <= hops_back < hops:
                    places[found, anchor] = way[hops_back][found]
                    known[found, anchor] = True
                elif hops_back >= hops:
                    places[found, anchor] = pasts[earlier].places[match, anchor]
                    known[found, anchor] = pasts[earlier].since[match] <= anchor
            waiting[found] = False
            way.append(geometry.copy())
        since = np.where(known.any(axis=1), known.argmax(axis=1), len(anchors))
        pasts.append(_Past(places, since.astype(np.int64)))
    return pasts


def _likeness(features: Sequence[FeatureSet]) -> float:
    """The distance between descriptors up to which they are alike, from those of different features of one frame."""
    apart = [np.linalg.norm(found.descriptors[1:] - found.descriptors[:-1], axis=1) for found in features]
    distances = np.concatenate(apart)
    return LIKENESS * float(np.median(distances)) if len(distances) else 0.0


def _alike_and_near(
    own: FeatureSet,
    rows: Int64[np.ndarray, " r"],
    led_to: Float32[np.ndarray, "n g"],
    there: FeatureSet,
    likeness: float,
    tolerance_px: float,
) -> Int64[np.ndarray, " r"]:
    """For each of the rows of a frame's features, the most similar one near where the flow led it to, or -1."""
    if len(rows) == 0 or len(there) == 0:
        return np.full(len(rows), -1)
    difference = np.linalg.norm(own.descriptors[rows][:, None] - there.descriptors[None], axis=2)
    near = _distance(own.node_type, led_to[rows], there.geometry) <= tolerance_px
    difference = np.where(near, difference, np.inf)
    best = difference.argmin(axis=1)
    return np.where(difference[np.arange(len(rows)), best] <= likeness, best, -1)


def _distance(
    node_type: NodeType, some: Float32[np.ndarray, "r g"], others: Float32[np.ndarray, "n g"]
) -> Float32[np.ndarray, "r n"]:
    """Between points; of segments, whose ends come and go, from the midpoint of one to the other's nearest point."""
    ends = others.reshape(len(others), others.shape[1] // 2, 2)
    center = some.reshape(len(some), some.shape[1] // 2, 2).mean(axis=1)[:, None]
    if node_type is NodeType.POINT:
        nearest = ends[None, :, 0]
    else:
        start, along = ends[:, 0], ends[:, 1] - ends[:, 0]
        length_squared = np.maximum((along**2).sum(axis=1), 1e-12)
        share = ((center - start) * along).sum(axis=2) / length_squared
        nearest = start + share.clip(0.0, 1.0)[..., None] * along
    distance: np.ndarray = np.linalg.norm(center - nearest, axis=2)
    return distance


def _ends(
    features: Sequence[FeatureSet], flows: Sequence[Flow], hop: int
) -> list[tuple[Float32[np.ndarray, "n g"], Bool[np.ndarray, " n"]]]:
    """Where each frame's features lie at the end, and whether that is known."""
    ends: list[tuple[np.ndarray, np.ndarray]] = []
    for track in tracks_to_the_end(features, flows, hop):
        own = features[track.start].geometry
        way = np.linalg.norm((track.geometry - own).reshape(len(own), own.shape[1] // 2, 2), axis=2).max(
            axis=1, initial=0.0
        )
        rests = ~track.followed & (way <= REST_PX)
        ends.append((np.where(track.followed[:, None], track.geometry, own), track.followed | rests))
    return ends
