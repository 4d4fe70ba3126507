"""A demonstration as the transitions that training learns from.

::

    frame      0 . . t . . t+gap . .
    features         F       G            extracted on both, unrelated
    tracked          F ----> F'           F followed to t+gap: each instance of F knows its own change of error
                     G' <--- G            and each instance of G knows where it came from
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TypeVar, final

import numpy as np
import torch
from torch.utils.data import Dataset

from geoskill.errors import InputError
from geoskill.features.feature_set import FeatureSet
from geoskill.features.flow import follow_features
from geoskill.features.pipeline import FeaturePipeline
from geoskill.geometry.primitives import NodeType
from geoskill.graphs.motif_graph import Motion, MotifGraph, motif_graph
from geoskill.kernels.kernel import Kernel, node_types

Item = TypeVar("Item")
Progress = Callable[[Sequence[Item], str], Iterable[Item]]
Transition = dict[str, dict[str, MotifGraph]]


def silent(items: Sequence[Item], description: str) -> Iterable[Item]:
    """The progress display that shows nothing."""
    return items


@final
@dataclass(frozen=True)
class MemberInputs:
    """One member of the ensemble: its kernel, and the name of the extractor that feeds each node type."""

    kernel: Kernel
    extractors: Mapping[NodeType, str]


@final
class Demonstration(Dataset[Transition]):
    """The transitions (t, t + gap) of one demonstration, for every member of the ensemble.

    Args:
        frames: ``[H, W, 3]`` RGB pictures in the order of time.
        pipelines: the extractors by name.
        members: what each member takes from them.
        gap: frames between the two of a transition.
        progress: shows progress over a sequence.

    Raises:
        InputError: when there are not more frames than ``gap``, or no frame has an instance of some member.
    """

    def __init__(
        self,
        frames: Sequence[np.ndarray],
        pipelines: Mapping[str, FeaturePipeline],
        members: Mapping[str, MemberInputs],
        *,
        gap: int,
        progress: Progress[int] = silent,
    ) -> None:
        if gap < 1:
            raise InputError(f"demonstration.gap={gap}: expected at least 1")
        if len(frames) <= gap:
            raise InputError(f"the demonstration has {len(frames)} frames; expected more than demonstration.gap={gap}")
        self.gap = gap
        self.members = dict(members)
        numbers = range(len(frames))
        self.features: dict[str, list[FeatureSet]] = {name: [] for name in pipelines}
        for t in progress(numbers, "extracting features"):
            for name, pipeline in pipelines.items():
                self.features[name].append(pipeline.extract(frames[t]))
        self._forward: dict[str, list[Motion]] = {name: [] for name in pipelines}
        self._backward: dict[str, list[Motion]] = {name: [] for name in pipelines}
        for t in progress(numbers[:-gap], "following features"):
            for name, found in self.features.items():
                self._forward[name].append(_motion(found[t], frames[t], frames[t + gap]))
                self._backward[name].append(_motion(found[t + gap], frames[t + gap], frames[t]))
        for name, member in self.members.items():
            if not any(self._has_instance(member, t) for t in numbers):
                raise InputError(
                    f"no frame of the demonstration has features for one {name} association; expected at least two"
                    " features on some frame (raise features.min_side or choose another descriptor)"
                )

    def _has_instance(self, member: MemberInputs, t: int) -> bool:
        counts = {kind: len(self.features[name][t]) for kind, name in member.extractors.items()}
        return member.kernel.instances(counts).shape[1] > 0

    def __len__(self) -> int:
        return len(next(iter(self._forward.values())))

    def __getitem__(self, t: int) -> Transition:
        """For each member, the graphs of the ``first`` and the ``second`` frame of transition ``t``."""
        return {
            name: {
                "first": self._graph(member, t, self._forward, t),
                "second": self._graph(member, t + self.gap, self._backward, t),
            }
            for name, member in self.members.items()
        }

    def _graph(
        self, member: MemberInputs, frame: int, motions: Mapping[str, Sequence[Motion]], transition: int
    ) -> MotifGraph:
        kinds = node_types(member.kernel)
        found = {kind: self.features[member.extractors[kind]][frame] for kind in kinds}
        motion = {kind: motions[member.extractors[kind]][transition] for kind in kinds}
        return motif_graph(member.kernel, found, motion)


def _motion(features: FeatureSet, start: np.ndarray, end: np.ndarray) -> Motion:
    geometry, followed = follow_features(features.node_type, features.geometry, start, end)
    return Motion(torch.from_numpy(geometry), torch.from_numpy(followed))
