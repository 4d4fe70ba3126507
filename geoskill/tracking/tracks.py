"""Tracking of every frame's features through a demonstration, over several spans of time at once.

::

    frame      t      t+hop    t+2 hop   ...    t+span
    F_t  ---->  .  ---->  .  ---->  .   ...  ---->  F_t's features at t+span

Each arrow tracks the features of all earlier frames along one optical flow, so a long span needs no more flows than a
short one. A feature that is lost once stays lost.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import final

import numpy as np
import torch
from jaxtyping import Bool, Float32

from geoskill.features.feature_set import FeatureSet
from geoskill.geometry.primitives import NodeType
from geoskill.tracking.flow import Flow, track_dense
from geoskill.tracking.motion import Displacement


@final
@dataclass(frozen=True, eq=False)
class Track:
    """The features of one frame, tracked for some hops.

    Attributes:
        start: the frame in which the features were detected.
        hops: number of hops since then.
        geometry: ``[n, g]``, positions in pixels after the last hop, or before the hop in which a feature was lost.
        tracked: ``[n]``, whether the feature has been tracked all the way.
    """

    start: int
    hops: int
    geometry: Float32[np.ndarray, "n g"]
    tracked: Bool[np.ndarray, " n"]


def chain_displacements(
    features: Sequence[FeatureSet], flows: Sequence[Flow], hop: int, spans: Sequence[int]
) -> dict[tuple[int, int], Displacement]:
    """Compute the displacements of the features of each frame ``t`` to frames ``t + span`` and ``t - span``.

    Args:
        features: of every frame, all of one type.
        flows: see :func:`~geoskill.tracking.neighbor_flows.neighbor_flows`.
        hop: number of frames from the first to the second frame of a flow.
        spans: positive multiples of ``hop``.

    Returns:
        A displacement for each ``(t, span)`` and each ``(t, -span)`` within the demonstration.
    """
    displacements: dict[tuple[int, int], Displacement] = {}
    longest = max(spans) // hop
    last = len(features) - 1
    live: dict[tuple[int, int], list[Track]] = {}
    for direction in (1, -1):  # one after the other, for the flows may be computed as they are asked for
        for step in range(len(features)):
            here = step if direction == 1 else last - step
            there = here + direction * hop
            if not 0 <= there <= last:
                continue
            flow = flows[here] if direction == 1 else flows[there].reversed()
            tracks = live.pop((direction, here), [])
            tracks = _advance([*tracks, _new_track(here, features[here])], features[here].node_type, flow)
            for track in tracks:
                span = track.hops * hop
                if span in spans:
                    displacements[track.start, direction * span] = _displacement(track, features[track.start])
            live[direction, there] = [track for track in tracks if track.hops < longest]
    return displacements


def tracks_to_end(features: Sequence[FeatureSet], flows: Sequence[Flow], hop: int) -> list[Track]:
    """Track every frame's features as long as whole hops fit into the demonstration; sorted by start."""
    live: dict[int, list[Track]] = {}
    ended: list[Track] = []
    for frame, detected in enumerate(features):
        tracks = [*live.pop(frame, []), _new_track(frame, detected)]
        if frame < len(flows):
            live[frame + hop] = _advance(tracks, detected.node_type, flows[frame])
        else:
            ended += tracks
    return sorted(ended, key=lambda track: track.start)


def _new_track(frame: int, features: FeatureSet) -> Track:
    return Track(frame, 0, features.geometry, np.ones(len(features), bool))


def _displacement(track: Track, features: FeatureSet) -> Displacement:
    geometry = np.where(track.tracked[:, None], track.geometry, features.geometry)
    return Displacement(torch.from_numpy(geometry), torch.from_numpy(track.tracked))


def _advance(tracks: Sequence[Track], node_type: NodeType, flow: Flow) -> list[Track]:
    """Track the features of all tracks along one flow."""
    live_geometry = np.concatenate([track.geometry[track.tracked] for track in tracks])
    live_geometry, live_tracked = track_dense(node_type, live_geometry, flow)
    advanced = []
    offset = 0
    for track in tracks:
        rows = np.flatnonzero(track.tracked)
        block = slice(offset, offset + len(rows))
        offset += len(rows)
        geometry, tracked = track.geometry.copy(), track.tracked.copy()
        geometry[rows], tracked[rows] = live_geometry[block], live_tracked[block]
        advanced.append(replace(track, hops=track.hops + 1, geometry=geometry, tracked=tracked))
    return advanced
