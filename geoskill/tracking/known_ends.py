"""What the places of the carried thing tell of every frame's features, in place of what tracking says of them.

::

    at rest at either place      it is known where the feature is at the start and at the end
    in between                   a feature where the thing is seen moves with it; one that looks like one of the thing
                                 at rest, and like nothing else, is that one
    background                   it stays where it is
    around the thing             unknown: it may belong to either
    the rest                     unrelated: a person, or what a person covers; it does not define the task
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import final

import numpy as np
import torch
from jaxtyping import Bool, Float32, Int64

from geoskill.features.feature_set import FeatureSet
from geoskill.features.preference import FeaturePreference, merged
from geoskill.tracking.motion import Displacement, Part, Trajectory
from geoskill.tracking.places import Places, is_in

# A feature in between is one of the thing when it differs from that less than this times what it differs from all
# others by.
SAME_FEATURE_RATIO = 0.9
# Other features it is compared with, at most: every so many of them serve as well.
MAX_OTHERS = 4000


@final
@dataclass(frozen=True, eq=False)
class KnownEnds:
    """What is known of one frame's ``n`` features.

    Attributes:
        part: the :class:`Part` of each feature.
        at_rest: whether a feature is on the thing at one of its places.
        carried: whether a feature is seen on the thing between its places.
        start, end: ``[n, g]`` in pixels of the first frame; where the feature is now where not known.
    """

    part: Int64[np.ndarray, " n"]
    at_rest: Bool[np.ndarray, " n"]
    carried: Bool[np.ndarray, " n"]
    start: Float32[np.ndarray, "n g"]
    end: Float32[np.ndarray, "n g"]

    @property
    def known(self) -> Bool[np.ndarray, " n"]:
        """``[n]``, whether the place at the start and at the end is known."""
        return np.asarray((self.part == Part.THING) | (self.part == Part.BACKGROUND))


def known_ends(features: Sequence[FeatureSet], places: Places) -> list[KnownEnds]:
    """Return what is known of the features of every frame, all of one type."""
    resting = [_resting(own, frame, len(features), places) for frame, own in enumerate(features)]
    at_rest = [
        (own, ends)
        for frame, (own, ends) in enumerate(zip(features, resting, strict=True))
        if not places.carried(frame)
    ]
    thing = [own.descriptors[ends.at_rest] for own, ends in at_rest]
    others = np.concatenate([own.descriptors[ends.part >= Part.BACKGROUND] for own, ends in at_rest])
    pool = _Pool(
        np.concatenate(thing),
        others[:: max(1, len(others) // MAX_OTHERS)],
        np.concatenate([ends.start[ends.at_rest] for _, ends in at_rest]),
        np.concatenate([ends.end[ends.at_rest] for _, ends in at_rest]),
    )
    return [
        _recognized(own, ends, pool) if frame >= places.picked else ends
        for frame, (own, ends) in enumerate(zip(features, resting, strict=True))
    ]


def preference_of(candidates: Mapping[int, FeatureSet], count: int, places: Places) -> FeaturePreference | None:
    """Return which features to keep: those of the thing, and those of the background next to its new place.

    Args:
        candidates: features of frames in which the thing rests, by the frame's number.
        count: number of frames of the demonstration.
        places: of the thing.

    Returns:
        None when one of the two has no feature at all.
    """
    thing, target, others = [], [], []
    for frame, features in candidates.items():
        part = _resting(features, frame, count, places).part
        near = is_in(places.around_new, places.camera.to_first(frame, features.geometry))
        thing.append(features.descriptors[part == Part.THING])
        target.append(features.descriptors[(part == Part.BACKGROUND) & near])
        others.append(features.descriptors[(part == Part.UNRELATED) | ((part == Part.BACKGROUND) & ~near)])
    groups = (np.concatenate(thing), np.concatenate(target), np.concatenate(others))
    if not all(len(group) for group in groups):
        return None
    return merged([FeaturePreference(groups[:2], groups[2])])


def with_known_displacements(
    displacements: Mapping[tuple[int, int], Displacement],
    features: Sequence[FeatureSet],
    places: Places,
    ends: Sequence[KnownEnds],
) -> dict[tuple[int, int], Displacement]:
    """Return the displacements, corrected where the places tell more; see :func:`chain_displacements`."""
    corrected = {}
    for (frame, span), displacement in displacements.items():
        known, other = ends[frame], frame + span
        own = places.camera.to_first(frame, features[frame].geometry)
        geometry, tracked = displacement.next_geometry.numpy().copy(), displacement.tracked.numpy().copy()
        moved = places.moved(frame, other, own)
        if moved is not None:
            on_thing = known.at_rest | known.carried
            geometry[on_thing] = places.camera.from_first(other, moved[on_thing])
            tracked[on_thing] = True
        background, unrelated = known.part == Part.BACKGROUND, known.part == Part.UNRELATED
        geometry[background], tracked[background] = places.camera.from_first(other, own[background]), True
        geometry[unrelated], tracked[unrelated] = features[frame].geometry[unrelated], False
        corrected[frame, span] = Displacement(torch.from_numpy(geometry), torch.from_numpy(tracked))
    return corrected


def trajectory_of(ends: KnownEnds, anchors: int) -> Trajectory:
    """Return the trajectory of one frame's features: from the start to the end where these are known, else unknown.

    Args:
        ends: what is known of the features.
        anchors: number of past frames in a trajectory; at all of them a feature is where it was at the start.
    """
    known = torch.from_numpy(ends.known)
    return Trajectory(
        torch.from_numpy(ends.start)[:, None].repeat(1, anchors, 1),
        torch.where(known, 0, anchors),
        torch.from_numpy(ends.end),
        known,
        torch.from_numpy(ends.part),
    )


@final
@dataclass(frozen=True, eq=False)
class _Pool:
    """Features of the frames in which the thing rests: those on it, with their ends, and others."""

    thing: Float32[np.ndarray, "p d"]
    others: Float32[np.ndarray, "q d"]
    start: Float32[np.ndarray, "p g"]
    end: Float32[np.ndarray, "p g"]


def _resting(own: FeatureSet, frame: int, count: int, places: Places) -> KnownEnds:
    """Return what the places alone tell of a frame's features."""
    thing, background = places.resting(frame)
    region = places.carried_region(frame)
    geometry = places.camera.to_first(frame, own.geometry)
    nowhere = np.zeros(len(own), bool)
    at_rest = nowhere if thing is None else is_in(thing, geometry)
    carried, near = (nowhere, nowhere) if region is None else (is_in(own_region, geometry) for own_region in region)
    on_thing = at_rest | carried
    ends = [places.moved(frame, other, geometry) if on_thing.any() else None for other in (0, count - 1)]
    start, end = (geometry if moved is None else np.where(on_thing[:, None], moved, geometry) for moved in ends)
    unsure = near | is_in(places.seam(frame), geometry)
    part = np.select(
        [on_thing, is_in(background, geometry), unsure],
        [Part.THING, Part.BACKGROUND, Part.UNKNOWN],
        default=Part.UNRELATED,
    )
    return KnownEnds(part.astype(np.int64), at_rest, carried, start, end)


def _recognized(own: FeatureSet, ends: KnownEnds, pool: _Pool) -> KnownEnds:
    """Add the features that look like one of the thing at rest, wherever they are: the path may be wrong.

    Others of the thing in motion count as unrelated. That costs less than to know nothing of the person next to it
    (docs/experiments/places.md).
    """
    rows = np.flatnonzero(~ends.known)
    start, end, matched = ends.start.copy(), ends.end.copy(), np.zeros(len(own), bool)
    if len(rows) and len(pool.thing) and len(pool.others):
        difference = _differences(own.descriptors[rows], pool.thing)
        best = difference.argmin(axis=1)
        other = _differences(own.descriptors[rows], pool.others).min(axis=1)
        same = difference[np.arange(len(rows)), best] < SAME_FEATURE_RATIO * other
        matched[rows[same]] = True
        start[matched], end[matched] = pool.start[best[same]], pool.end[best[same]]
    return replace(ends, part=np.where(matched, Part.THING, ends.part), start=start, end=end)


def _differences(first: Float32[np.ndarray, "n d"], second: Float32[np.ndarray, "m d"]) -> Float32[np.ndarray, "n m"]:
    """Return the distances between descriptors of unit norm."""
    return np.asarray(np.sqrt(np.maximum(0.0, 2.0 - 2.0 * first @ second.T)), np.float32)
