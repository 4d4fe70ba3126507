"""Following every frame's features through a demonstration, over several spans of time at once.

::

    frame      t      t+hop    t+2 hop   ...    t+span
    F_t  ---->  .  ---->  .  ---->  .   ...  ---->  F_t's features at t+span

Each arrow is one call of :func:`~geoskill.features.flow.follow_features` on the features of all earlier frames that are
still followed, so a long span costs no more calls than a short one. A feature that is lost once stays lost.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import final

import numpy as np
import torch
from jaxtyping import Bool, Float32

from geoskill.features.feature_set import FeatureSet
from geoskill.features.flow import follow_features
from geoskill.graphs.motif_graph import Motion

Progress = Callable[[Sequence[int], str], Iterable[int]]


@final
@dataclass(frozen=True, eq=False)
class _Track:
    """The features of frame ``start``, where they are now and which of them are still followed."""

    start: int
    hops: int
    geometry: Float32[np.ndarray, "n g"]
    followed: Bool[np.ndarray, " n"]


def chain_motions(
    features: Sequence[FeatureSet], frames: Sequence[np.ndarray], hop: int, spans: Sequence[int], progress: Progress
) -> dict[tuple[int, int], Motion]:
    """Where the features of frame ``t`` lie in frame ``t + span``.

    Args:
        features: of every frame, all of one type.
        frames: ``[H, W, 3]`` RGB, as many.
        hop: frames between two calls of the tracker.
        spans: positive multiples of ``hop``.
        progress: shows progress over the frames.

    Returns:
        A motion for each ``(t, span)`` and each ``(t, -span)`` that stays within the demonstration.
    """
    motions: dict[tuple[int, int], Motion] = {}
    longest = max(spans) // hop
    last = len(frames) - 1
    live: dict[tuple[int, int], list[_Track]] = {}
    for step in progress(range(len(frames)), "following features"):
        for direction in (1, -1):
            here = step if direction == 1 else last - step
            there = here + direction * hop
            if not 0 <= there <= last:
                continue
            tracks = live.pop((direction, here), [])
            found = features[here]
            tracks.append(_Track(here, 0, found.geometry, np.ones(len(found), bool)))
            tracks = _advance(tracks, features, frames[here], frames[there])
            for track in tracks:
                span = track.hops * hop
                if span in spans:
                    own = features[track.start].geometry
                    geometry = np.where(track.followed[:, None], track.geometry, own)
                    motions[track.start, direction * span] = Motion(
                        torch.from_numpy(geometry), torch.from_numpy(track.followed)
                    )
            live[direction, there] = [track for track in tracks if track.hops < longest]
    return motions


def _advance(
    tracks: Sequence[_Track], features: Sequence[FeatureSet], here: np.ndarray, there: np.ndarray
) -> list[_Track]:
    """All tracks one hop further, in one call of the tracker."""
    node_type = features[tracks[0].start].node_type
    moving = np.concatenate([track.geometry[track.followed] for track in tracks])
    geometry, followed = follow_features(node_type, moving, here, there)
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
