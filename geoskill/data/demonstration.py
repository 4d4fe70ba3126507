"""A demonstration as the transitions that training learns from.

::

    frame      0 . . t . . . . t+span . .
    features         F         G             extracted on both, unrelated
    tracked          F ------> F'            each instance of F knows how its own error changes until t+span
                     G' <----- G             each instance of G knows how its own error changed since t
"""

from collections.abc import Iterator, Mapping, Sequence
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
from geoskill.geometry.primitives import NodeType
from geoskill.graphs.motif_graph import MotifGraph, feature_graph, motif_graph, with_instances
from geoskill.io.prefetch import Progress, parallel_map
from geoskill.model.kernel_model import KernelModel
from geoskill.tracking.motion import Displacement
from geoskill.tracking.tracks import chain_displacements, neighbor_flows
from geoskill.tracking.trajectories import trajectories

# Features of a frame that are observed: what is fitted to thousands of transitions does not need the instances of more.
MAX_FIT_FEATURES = 100


def time_spans(frame_count: int, gap: int, horizon: float) -> tuple[int, ...]:
    """The lengths of transitions in frames: the gap and its doublings up to a share of the demonstration.

    A short span compares what the hand does now; only a long one tells an object that arrives from one that passes,
    and only a long one tells anything about frames in which nothing moves any more.

    Args:
        frame_count: frames of the demonstration.
        gap: the shortest span.
        horizon: the longest span's share of the demonstration, in [0, 1]; 0 leaves the gap alone.

    Raises:
        InputError: when a number is out of range, or the demonstration is no longer than the gap.

    >>> time_spans(100, 2, 0.5)
    (2, 4, 8, 16, 32)
    """
    if gap < 1:
        raise InputError(f"demonstration.gap={gap}: expected at least 1")
    if not 0 <= horizon <= 1:
        raise InputError(f"demonstration.horizon={horizon}: expected a share from 0 to 1")
    if frame_count <= gap:
        raise InputError(f"the demonstration has {frame_count} frames; expected more than demonstration.gap={gap}")
    spans = [gap]
    while 2 * spans[-1] <= horizon * (frame_count - 1):
        spans.append(2 * spans[-1])
    return tuple(spans)


@final
class Demonstration(Transitions):
    """The transitions of one demonstration, over all spans, for every member of the ensemble.

    Args:
        frames: ``[H, W, 3]`` RGB pictures in the order of time.
        pipelines: the extractors by name.
        members: which kernels there are, and what each takes from the extractors.
        gap: the shortest transition in frames, and the hop of the tracker.
        horizon: see :func:`time_spans`.
        negatives: how many features that never were there each frame is given (:mod:`geoskill.data.negatives`).
        progress: shows progress over a sequence.
        name: what it is called in messages.
        threads: how many frames are worked on at once; what comes out does not depend on it.

    Raises:
        InputError: when ``gap`` or ``horizon`` does not fit, or no frame has an instance of some member.
    """

    def __init__(
        self,
        frames: Sequence[np.ndarray],
        pipelines: Mapping[str, FeaturePipeline],
        members: Mapping[str, KernelModel],
        *,
        gap: int,
        horizon: float,
        num_negatives: int,
        progress: Progress,
        name: str = "the demonstration",
        threads: int = 1,
    ) -> None:
        self.frame_count = len(frames)
        self._spans = time_spans(len(frames), gap, horizon)
        self.members = dict(members)
        numbers = range(len(frames))
        self._transitions = [(t, i) for i, span in enumerate(self._spans) for t in numbers[:-span]]

        def extract(frame: np.ndarray) -> dict[str, FeatureSet]:
            return {name: pipeline.extract(frame) for name, pipeline in pipelines.items()}

        extracted = parallel_map(
            extract, frames, numbers, threads=threads, progress=progress, description="extracting features"
        )
        self._features = {name: [features[name] for features in extracted] for name in pipelines}
        for of_member, member in self.members.items():
            if not any(self._has_instance(member, t) for t in numbers):
                raise InputError(
                    f"no frame of {name} has an association of {of_member}; expected features of type"
                    f" {' and '.join(member.extractors)} (raise features.min_side or choose another descriptor)"
                )
        flows = neighbor_flows(frames, gap, progress, threads)
        self._motions: dict[str, Mapping[tuple[int, int], Displacement]] = {
            name: chain_displacements(found, flows, gap, self._spans) for name, found in self._features.items()
        }
        self._num_negatives = num_negatives
        wanted = pipelines if num_negatives > 0 else {}
        self._negatives = {
            name: synthesize_negatives(frames, pipeline, progress, threads) for name, pipeline in wanted.items()
        }
        shorter_side = min(frames[0].shape[:2])
        self._trajectories = {
            name: trajectories(found, flows, gap, shorter_side) for name, found in self._features.items()
        }

    def _has_instance(self, member: KernelModel, t: int) -> bool:
        counts = {kind: len(self._features[name][t]) for kind, name in member.extractors.items()}
        return member.kernel.instances(counts).shape[1] > 0

    def __len__(self) -> int:
        return len(self._transitions)

    def descriptors(self, name: str) -> dict[NodeType, Tensor]:
        """See :meth:`Transitions.descriptors`."""
        extractors = self.members[name].extractors
        return {
            kind: torch.from_numpy(np.concatenate([found.descriptors for found in self._features[extractor]]))
            for kind, extractor in extractors.items()
        }

    @property
    def spans(self) -> tuple[int, ...]:
        """See :attr:`Transitions.spans`."""
        return self._spans

    def __getitem__(self, index: int) -> Transition:
        """See :meth:`Transitions.__getitem__`."""
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
        """See :meth:`Transitions.frames`."""
        member = self.members[name]
        for t in range(self.frame_count):
            yield motif_graph(member.kernel, {kind: self._features[x][t] for kind, x in member.extractors.items()})

    def graph_without_negatives(self, name: str, index: int) -> MotifGraph:
        """See :meth:`Transitions.graph_without_negatives`."""
        t, span_index = self._transitions[index]
        member = self.members[name]
        graph = self._graph(member, t, self._spans[span_index], span_index, negatives=False)
        shown = {kind: _spread(int(graph[f"{kind}_count"])) for kind in member.node_types}
        return with_instances(member.kernel, graph, shown)

    def _graph(self, member: KernelModel, frame: int, span: int, span_index: int, negatives: bool = True) -> MotifGraph:
        features, motion, trajectory = {}, {}, {}
        for kind in member.node_types:
            name = member.extractors[kind]
            found = self._features[name][frame], self._motions[name][frame, span], self._trajectories[name][frame]
            if negatives and self._num_negatives > 0:
                found = append_negatives(*found, self._sample_negatives(name, frame, span))
            features[kind], motion[kind], trajectory[kind] = found
        graph = feature_graph(member.kernel, features, motion, trajectory)
        graph.span_index = torch.tensor([span_index])
        return graph

    def _sample_negatives(self, name: str, frame: int, span: int) -> FeatureSet:
        """Others for each frame and span, the same whenever they are asked for."""
        pool = self._negatives[name]
        random = np.random.default_rng([frame, span + len(self._transitions)])
        return pool.take(random.permutation(len(pool))[: self._num_negatives])


def _spread(count: int) -> Bool[Tensor, " n"]:
    """Of many features, some of all strengths: they are in the order of it."""
    shown = torch.zeros(count, dtype=torch.bool)
    shown[torch.linspace(0, count - 1, min(count, MAX_FIT_FEATURES)).round().long()] = True
    return shown
