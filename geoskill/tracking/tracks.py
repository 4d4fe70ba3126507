"""Following every frame's features through a demonstration, over several spans of time at once.

::

    frame      t      t+hop    t+2 hop   ...    t+span
    F_t  ---->  .  ---->  .  ---->  .   ...  ---->  F_t's features at t+span

Each arrow follows the features of all earlier frames along one optical flow, so a long span costs no more flows than a
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
from geoskill.io.prefetch import Progress, parallel_map
from geoskill.tracking.flow import Flow, dense_flow, track_dense
from geoskill.tracking.motion import Displacement


@final
@dataclass(frozen=True, eq=False)
class Track:
    """The features of frame ``start``, where they are ``hops`` later and which of them are still followed.

    Attributes:
        geometry: where a feature was lost, its last place.
    """

    start: int
    hops: int
    geometry: Float32[np.ndarray, "n g"]
    followed: Bool[np.ndarray, " n"]


def neighbor_flows(frames: Sequence[np.ndarray], hop: int, progress: Progress, threads: int = 1) -> list[Flow]:
    """The flow from every frame ``t`` to frame ``t + hop``.

    Args:
        frames: ``[H, W, 3]`` RGB pictures.
        hop: frames between the two of a flow.
        progress: shows progress over the frames.
        threads: how many flows are computed at once.
    """
    starts = range(len(frames) - hop)

    def flow(start: int) -> Flow:
        return dense_flow(frames[start], frames[start + hop])

    return parallel_map(flow, starts, starts, threads=threads, progress=progress, description="following motion")


def chain_motions(
    features: Sequence[FeatureSet], flows: Sequence[Flow], hop: int, spans: Sequence[int]
) -> dict[tuple[int, int], Displacement]:
    """Where the features of frame ``t`` lie in frame ``t + span``.

    Args:
        features: of every frame, all of one type.
        flows: of :func:`neighbor_flows`.
        hop: frames between the two of a flow.
        spans: positive multiples of ``hop``.

    Returns:
        A motion for each ``(t, span)`` and each ``(t, -span)`` that stays within the demonstration.
    """
    motions: dict[tuple[int, int], Displacement] = {}
    longest = max(spans) // hop
    last = len(features) - 1
    live: dict[tuple[int, int], list[Track]] = {}
    for step in range(len(features)):
        for direction in (1, -1):
            here = step if direction == 1 else last - step
            there = here + direction * hop
            if not 0 <= there <= last:
                continue
            flow = flows[here] if direction == 1 else flows[there].reversed()
            found = features[here]
            tracks = live.pop((direction, here), [])
            tracks.append(Track(here, 0, found.geometry, np.ones(len(found), bool)))
            tracks = _advance(tracks, found.node_type, flow)
            for track in tracks:
                span = track.hops * hop
                if span in spans:
                    own = features[track.start].geometry
                    geometry = np.where(track.followed[:, None], track.geometry, own)
                    motions[track.start, direction * span] = Displacement(
                        torch.from_numpy(geometry), torch.from_numpy(track.followed)
                    )
            live[direction, there] = [track for track in tracks if track.hops < longest]
    return motions


def tracks_to_the_end(features: Sequence[FeatureSet], flows: Sequence[Flow], hop: int) -> list[Track]:
    """Every frame's features, followed as long as whole hops fit into the demonstration."""
    live: dict[int, list[Track]] = {}
    ended: list[Track] = []
    for t, found in enumerate(features):
        tracks = [*live.pop(t, []), Track(t, 0, found.geometry, np.ones(len(found), bool))]
        if t < len(flows):
            live[t + hop] = _advance(tracks, found.node_type, flows[t])
        else:
            ended += tracks
    return sorted(ended, key=lambda track: track.start)


def _advance(tracks: Sequence[Track], node_type: NodeType, flow: Flow) -> list[Track]:
    """All tracks one hop further."""
    moving = np.concatenate([track.geometry[track.followed] for track in tracks])
    geometry, followed = track_dense(node_type, moving, flow)
    advanced = []
    offset = 0
    for track in tracks:
        rows = np.flatnonzero(track.followed)
        part = slice(offset, offset + len(rows))
        offset += len(rows)
        moved, kept = track.geometry.copy(), track.followed.copy()
        moved[rows], kept[rows] = geometry[part], followed[part]
        advanced.append(replace(track, hops=track.hops + 1, geometry=moved, followed=kept))
    return advanced
