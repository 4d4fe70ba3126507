"""A demonstration as the transitions that training learns from.

::

    frame      0 . . t . . . . t+span . .
    features         F         G             extracted on both, unrelated
    tracked          F ------> F'            the change of error of every instance of F until t+span
                     G' <----- G             the change of error of every instance of G since t
"""

from collections.abc import Collection, Iterator, Mapping, Sequence
from typing import final

import numpy as np
import torch
from jaxtyping import Bool
from torch import Tensor

from geoskill.data.negatives import append_negatives, synthesize_negatives
from geoskill.data.transitions import Transition, Transitions
from geoskill.errors import InputError
from geoskill.features.feature_set import FeatureSet
from geoskill.features.pipeline import FeaturePipeline
from geoskill.features.preference import FeaturePreference
from geoskill.geometry.depth_picture import DepthPicture
from geoskill.geometry.primitives import NodeType
from geoskill.graphs.motif_graph import MotifGraph, feature_graph, motif_graph, take_features, with_instances
from geoskill.io.frames import EXPECTED_DEPTH
from geoskill.io.prefetch import Progress, parallel_map
from geoskill.model.kernel_model import KernelModel
from geoskill.tracking.known_ends import known_ends, preference_of, trajectory_of, with_known_displacements
from geoskill.tracking.motion import Displacement, Trajectory
from geoskill.tracking.neighbor_flows import neighbor_flows
from geoskill.tracking.places import Places, find_places
from geoskill.tracking.space import end_frames, flow_frames, lift_motions
from geoskill.tracking.tracks import chain_displacements
from geoskill.tracking.trajectories import trajectories
from geoskill.tuning import NegativesConfig, TrajectoryConfig

# Limit of features per type in a frame for statistics that are fitted to all transitions, which do not need more.
MAX_FIT_FEATURES = 100
# Frames that a preference is drawn from, about: a thing at rest looks the same in all of them.
MAX_PREFERENCE_FRAMES = 20


def time_spans(frame_count: int, gap: int, max_span_ratio: float) -> tuple[int, ...]:
    """Return the lengths of transitions in frames: the gap, doubled up to a share of the demonstration.

    A short span compares what the hand does now. Only a long one tells an object that reaches its target from one that
    passes it, and only a long one says anything about frames in which nothing moves any more.

    Args:
        frame_count: frames of the demonstration.
        gap: the shortest span.
        max_span_ratio: limit of the longest span over the length of the demonstration, in [0, 1]; 0 for the gap only.

    Raises:
        InputError: when a number is out of range, or the demonstration is no longer than the gap.

    >>> time_spans(100, 2, 0.5)
    (2, 4, 8, 16, 32)
    """
    if gap < 1:
        raise InputError(f"gap={gap}: expected at least 1")
    if not 0 <= max_span_ratio <= 1:
        raise InputError(f"max_span_ratio={max_span_ratio}: expected a share from 0 to 1")
    if frame_count <= gap:
        raise InputError(f"the demonstration has {frame_count} frames; expected more than gap={gap}")
    spans = [gap]
    while 2 * spans[-1] <= max_span_ratio * (frame_count - 1):
        spans.append(2 * spans[-1])
    return tuple(spans)


@final
class Demonstration(Transitions):
    """The transitions of one demonstration, over all spans, for every member of the ensemble.

    Args:
        frames: ``[H, W, 3]`` RGB pictures in the order of time.
        pipelines: the extractors by name.
        members: the kernels, and the extractors that each of them uses.
        gap: the shortest transition in frames, and the step of the tracker.
        max_span_ratio: see :func:`time_spans`.
        num_negatives: number of synthetic features that are added to each frame (:mod:`geoskill.data.negatives`).
        progress: shows progress over a sequence.
        use_places: whether to look for the places of the carried thing (:mod:`geoskill.tracking.places`).
        name: the demonstration's name in messages.
        threads: number of frames that are worked on at once; the result does not depend on it.
        trajectory: anchors and thresholds of the trajectories; None for the defaults.
        negatives: pictures that the synthetic features come from; None for the defaults.
        depths: of the frames, which members in space need; None without depth.
        every_member: refuse a demonstration in which some member has no association; otherwise one must have any.

    Attributes:
        places: of the carried thing, where they were looked for and found.
        preferences: which features were kept, by the extractor's name, where the places tell.

    Raises:
        InputError: when ``gap`` or ``max_span_ratio`` is out of range, or no frame has an instance of some member,
            or of any.
    """

    def __init__(
        self,
        frames: Sequence[np.ndarray],
        pipelines: Mapping[str, FeaturePipeline],
        members: Mapping[str, KernelModel],
        *,
        gap: int,
        max_span_ratio: float,
        num_negatives: int,
        progress: Progress,
        use_places: bool = True,
        name: str = "the demonstration",
        threads: int = 1,
        trajectory: TrajectoryConfig | None = None,
        negatives: NegativesConfig | None = None,
        depths: Sequence[DepthPicture] | None = None,
        every_member: bool = True,
    ) -> None:
        _require_depth(members, depths, name)
        self.frame_count = len(frames)
        self._spans = time_spans(len(frames), gap, max_span_ratio)
        self.members = dict(members)
        numbers = range(len(frames))
        self._transitions = [(t, i) for i, span in enumerate(self._spans) for t in numbers[:-span]]

        self.places = find_places(frames) if use_places else None
        self.preferences = {} if self.places is None else _preferences(frames, depths, pipelines, self.places)
        preferring = {
            extractor: own.preferring(self.preferences.get(extractor)) for extractor, own in pipelines.items()
        }

        def extract(frame: tuple[np.ndarray, DepthPicture | None]) -> dict[str, FeatureSet]:
            return {extractor: pipeline.extract(*frame) for extractor, pipeline in preferring.items()}

        extracted = parallel_map(
            extract,
            zip(frames, [None] * len(frames) if depths is None else depths, strict=True),
            numbers,
            threads=threads,
            progress=progress,
            description="extracting features",
        )
        self._features = {extractor: [features[extractor] for features in extracted] for extractor in pipelines}
        self._require_instances(name, every_member)
        trajectory = TrajectoryConfig() if trajectory is None else trajectory
        flows = neighbor_flows(frames, gap, progress, threads, recent=gap * trajectory.max_gap_hops)
        self._motions: dict[str, Mapping[tuple[int, int], Displacement]] = {
            extractor: chain_displacements(features, flows, gap, self._spans)
            for extractor, features in self._features.items()
        }
        self._num_negatives = num_negatives
        negative_pipelines = pipelines if num_negatives > 0 else {}
        self._negatives = {
            extractor: synthesize_negatives(frames, pipeline, progress, threads, negatives, depths)
            for extractor, pipeline in negative_pipelines.items()
        }
        self._trajectories: dict[str, Sequence[Trajectory]] = {}
        for extractor, features in self._features.items():
            if self.places is None:
                shorter_side = min(frames[0].shape[:2])
                self._trajectories[extractor] = trajectories(features, flows, gap, shorter_side, trajectory)
            else:
                ends = known_ends(features, self.places)
                self._motions[extractor] = with_known_displacements(
                    self._motions[extractor], features, self.places, ends
                )
                self._trajectories[extractor] = [trajectory_of(known, trajectory.anchors) for known in ends]
        if depths is not None:
            self._lift(depths, gap, trajectory.anchors)

    def _lift(self, depths: Sequence[DepthPicture], gap: int, anchors: int) -> None:
        """Lift what is known of the motion of features that are in space."""
        frames = flow_frames(self.frame_count, gap, anchors)
        if self.places is not None:
            frames = end_frames(self.frame_count, anchors)
        for extractor, features in self._features.items():
            if features[0].space is not None:
                self._motions[extractor], self._trajectories[extractor] = lift_motions(
                    features, self._motions[extractor], self._trajectories[extractor], *frames, depths
                )

    def _require_instances(self, name: str, every_member: bool) -> None:
        lacking = {
            member_name: member
            for member_name, member in self.members.items()
            if not any(self._has_instance(member, t) for t in range(self.frame_count))
        }
        if every_member or len(lacking) == len(self.members):
            for member_name, member in lacking.items():
                raise InputError(
                    f"no frame of {name} has an association of {member_name}; expected features of type"
                    f" {' and '.join(member.extractors)} (raise min_side or choose another descriptor)"
                )

    def _has_instance(self, member: KernelModel, t: int) -> bool:
        features = {node_type: self._features[extractor][t] for node_type, extractor in member.extractors.items()}
        return bool(motif_graph(member.kernel, features).instance_index.shape[1] > 0)

    def keep(self, names: Collection[str]) -> None:
        """Forget all members but these, and what only the others need."""
        self.members = {name: member for name, member in self.members.items() if name in names}
        used = {extractor for member in self.members.values() for extractor in member.extractors.values()}
        for records in (self._features, self._motions, self._negatives, self._trajectories):
            for extractor in records.keys() - used:
                del records[extractor]
        self.preferences = {extractor: own for extractor, own in self.preferences.items() if extractor in used}

    def __len__(self) -> int:
        return len(self._transitions)

    def descriptors(self, name: str) -> dict[NodeType, Tensor]:
        """Return all descriptors; see :meth:`Transitions.descriptors`."""
        return {
            node_type: torch.from_numpy(
                np.concatenate([features.descriptors for features in self._features[extractor]])
            )
            for node_type, extractor in self.members[name].extractors.items()
        }

    @property
    def spans(self) -> tuple[int, ...]:
        """See :attr:`Transitions.spans`."""
        return self._spans

    def __getitem__(self, index: int) -> Transition:
        """Return a transition; see :meth:`Transitions.__getitem__`."""
        t, span_index = self._transitions[index]
        span = self._spans[span_index]
        return {
            name: {
                "first": self._graph(member, t, span, span_index),
                "second": self._graph(member, t + span, -span, span_index),
            }
            for name, member in self.members.items()
        }

    def frames(self, name: str) -> Iterator[MotifGraph]:
        """Yield the frames' graphs; see :meth:`Transitions.frames`."""
        member = self.members[name]
        for t in range(self.frame_count):
            features = {node_type: self._features[extractor][t] for node_type, extractor in member.extractors.items()}
            yield motif_graph(member.kernel, features)

    def graph_without_negatives(self, name: str, index: int) -> MotifGraph:
        """Return a frame's graph; see :meth:`Transitions.graph_without_negatives`."""
        t, span_index = self._transitions[index]
        member = self.members[name]
        graph = self._graph(member, t, self._spans[span_index], span_index, negatives=False)
        chosen = {node_type: _evenly_chosen(int(graph[f"{node_type}_count"])) for node_type in member.node_types}
        return with_instances(member.kernel, take_features(graph, chosen))

    def _graph(self, member: KernelModel, frame: int, span: int, span_index: int, negatives: bool = True) -> MotifGraph:
        features, displacement, trajectory = {}, {}, {}
        for node_type, name in member.extractors.items():
            records = self._features[name][frame], self._motions[name][frame, span], self._trajectories[name][frame]
            if negatives and self._num_negatives > 0:
                records = append_negatives(*records, self._sample_negatives(name, frame, span))
            features[node_type], displacement[node_type], trajectory[node_type] = records
        graph = feature_graph(member.kernel, features, displacement, trajectory)
        graph.span_index = torch.tensor([span_index])
        graph.by_progress = torch.tensor([self.places is not None])
        return graph

    def _sample_negatives(self, name: str, frame: int, span: int) -> FeatureSet:
        """Draw negatives that differ between frames and spans, but not between calls."""
        pool = self._negatives[name]
        # Of a few transitions, the sum is negative: spans back in time are.
        random = np.random.default_rng([frame, (span + len(self._transitions)) % 2**32])
        return pool.take(random.permutation(len(pool))[: self._num_negatives])


def _require_depth(members: Mapping[str, KernelModel], depths: Sequence[DepthPicture] | None, name: str) -> None:
    wanting = [member.kernel.name for member in members.values() if member.kernel.in_space]
    if wanting and depths is None:
        raise InputError(f"kernel={wanting[0]} needs depth, and {name} has none; {EXPECTED_DEPTH}")


def _preferences(
    frames: Sequence[np.ndarray],
    depths: Sequence[DepthPicture] | None,
    pipelines: Mapping[str, FeaturePipeline],
    places: Places,
) -> dict[str, FeaturePreference]:
    """Return which features of a demonstration to keep, by the extractor's name."""
    resting = [frame for frame in range(len(frames)) if not places.carried(frame)]
    looked_at = resting[:: max(1, len(resting) // MAX_PREFERENCE_FRAMES)]
    preferences = {}
    for extractor, pipeline in pipelines.items():
        candidates = {
            frame: pipeline.candidates(frames[frame], None if depths is None else depths[frame]) for frame in looked_at
        }
        preference = preference_of(candidates, len(frames), places)
        if preference is not None:
            preferences[extractor] = preference
    return preferences


def _evenly_chosen(count: int) -> Bool[Tensor, " n"]:
    """Choose at most :data:`MAX_FIT_FEATURES` features, evenly over their order, which is by strength."""
    chosen = torch.zeros(count, dtype=torch.bool)
    chosen[torch.linspace(0, count - 1, min(count, MAX_FIT_FEATURES)).round().long()] = True
    return chosen
