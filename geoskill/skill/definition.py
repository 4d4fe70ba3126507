"""The readable definition of a task: which features belong together, how surely, and what that constrains."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, final

import numpy as np
from jaxtyping import Float32

from geoskill.kernels.kernel import automorphisms
from geoskill.model.kernel_model import KernelModel
from geoskill.skill.association import Association, InferenceResult

# Cosine of two descriptors from which they count as views of one feature. Two frames of the same SIFT keypoint are
# mostly above 0.85, two unrelated ones below 0.6.
SAME_FEATURE = 0.75
LISTED = 5


@final
@dataclass(eq=False)
class _Group:
    """Top associations of several frames that join the same two features."""

    descriptors: list[Float32[np.ndarray, " _"]]
    best: Association
    best_frame: int
    frames: int = 1
    confidence: float = 0.0


@final
@dataclass(eq=False)
class _MemberHistory:
    frames: int = 0
    confidences: list[float] = field(default_factory=list)
    errors: list[float] = field(default_factory=list)
    groups: list[_Group] = field(default_factory=list)
    last: _Group | None = None


@final
class TaskDefinition:
    """Collects the inferences of a video, frame by frame, and sums them up.

    Args:
        members: the members of the skill, by name.
    """

    def __init__(self, members: Mapping[str, KernelModel]) -> None:
        self._members = members
        self._history = {name: _MemberHistory() for name in members}

    def add(self, frame_index: int, result: InferenceResult) -> None:
        """Take in one frame."""
        top = {association.member: association for association in result.associations if association.rank == 1}
        for name, member in self._members.items():
            history = self._history[name]
            history.frames += 1
            association = top.get((member.kernel.name, member.descriptor))
            if association is None:
                continue
            history.confidences.append(association.confidence)
            history.errors.append(float(np.linalg.norm(association.error)))
            sets = [result.features[member.extractors[role]] for role in member.kernel.roles]
            rows = [node.feature for node in association.nodes if node.feature is not None]
            if len(rows) == len(sets):
                descriptors = [found.descriptors[row] for found, row in zip(sets, rows, strict=True)]
                history.last = _group_of(
                    history.groups, descriptors, association, frame_index, automorphisms(member.kernel)
                )
            # One that was kept though not all of its features were detected is the same as before.
            if history.last is not None:
                history.last.frames += 1
                history.last.confidence += association.confidence

    def as_dict(self) -> dict[str, Any]:
        """The definition in plain values, as in ``skill.yaml``.

        Error norms ``at_start`` and ``at_end`` are medians over the first and the last tenth of the frames that have an
        association. ``share`` is the part of all frames in which an association, or another view of it, is the top one.
        """
        members = {name: self._member(name, member) for name, member in self._members.items()}
        return {
            "degrees_of_freedom": sum(entry["constrains"] for entry in members.values()),
            "members": members,
        }

    def _member(self, name: str, member: KernelModel) -> dict[str, Any]:
        history = self._history[name]
        seen = len(history.errors)
        tenth = max(1, seen // 10)
        groups = sorted(history.groups, key=lambda group: -group.frames)
        return {
            "kernel": member.kernel.name,
            "meaning": member.kernel.meaning,
            "descriptor": member.descriptor,
            "constrains": member.kernel.error_dim if seen else 0,
            "frames": history.frames,
            "frames_with_association": seen,
            "mean_confidence": round(float(np.mean(history.confidences)), 4) if seen else None,
            "error_norm": {
                "at_start": round(float(np.median(history.errors[:tenth])), 3) if seen else None,
                "at_end": round(float(np.median(history.errors[-tenth:])), 3) if seen else None,
            },
            "associations": [
                {
                    "share": round(group.frames / history.frames, 4),
                    "mean_confidence": round(group.confidence / group.frames, 4),
                    "seen_best_in_frame": group.best_frame,
                    "nodes": [node.as_json() for node in group.best.nodes],
                }
                for group in groups[:LISTED]
            ],
        }


def _group_of(
    groups: list[_Group],
    descriptors: list[Float32[np.ndarray, " _"]],
    association: Association,
    frame_index: int,
    orders: tuple[tuple[int, ...], ...],
) -> _Group:
    """The group that an association resembles most, or one that it founds."""
    best, likeness = None, SAME_FEATURE
    for group in groups:
        for order in orders:
            pairs = zip((descriptors[i] for i in order), group.descriptors, strict=True)
            alike = min(float(own @ other) for own, other in pairs)
            if alike > likeness:
                best, likeness = group, alike
    if best is None:
        best = _Group(descriptors, association, frame_index, frames=0)
        groups.append(best)
    if association.confidence > best.best.confidence:
        best.descriptors, best.best, best.best_frame = descriptors, association, frame_index
    return best
