"""Readable definition of a task: associated features, confidence, and constrained degrees of freedom."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, final

import numpy as np
from jaxtyping import Float32

from geoskill.kernels.kernel import automorphisms, constrained_freedom
from geoskill.model.kernel_model import KernelModel
from geoskill.skill.association import Association, InferenceResult
from geoskill.skill.member_status import MemberStatus

# Smallest cosine of two descriptors that count as views of one feature. Two frames of one SIFT keypoint are mostly
# above 0.85, two unrelated keypoints below 0.6.
MIN_SIMILARITY = 0.75
# Groups of associations listed for each member.
MAX_LISTED = 5


@final
@dataclass(eq=False)
class _Group:
    """Top associations of several frames that join the same features."""

    descriptors: Sequence[Float32[np.ndarray, " _"]]
    best: Association
    best_frame: int
    frames: int = 0
    confidence_sum: float = 0.0


@final
@dataclass(eq=False)
class _MemberHistory:
    """Top associations of one member over the frames so far."""

    frames: int = 0
    confidences: list[float] = field(default_factory=list)
    errors: list[float] = field(default_factory=list)
    groups: list[_Group] = field(default_factory=list)
    last_group: _Group | None = None


@final
class TaskDefinition:
    """Summary of the inference results of a video, collected frame by frame.

    Args:
        members: members of the skill, by name.
    """

    def __init__(self, members: Mapping[str, KernelModel]) -> None:
        self._members = members
        self._history = {name: _MemberHistory() for name in members}

    def add(self, frame_index: int, result: InferenceResult) -> None:
        """Add the result of one frame."""
        top = {association.member: association for association in result.associations if association.rank == 1}
        for name, member in self._members.items():
            history = self._history[name]
            history.frames += 1
            association = top.get(name)
            if association is None:
                continue
            history.confidences.append(association.confidence)
            history.errors.append(float(np.linalg.norm(association.error)))
            descriptors = [
                result.features[member.extractors[role]].descriptors[node.feature]
                for role, node in zip(member.kernel.roles, association.nodes, strict=True)
                if node.feature is not None
            ]
            if len(descriptors) == len(association.nodes):
                orders = automorphisms(member.kernel)
                history.last_group = _matching_group(history.groups, descriptors, association, frame_index, orders)
            # An association kept over a frame in which one of its features is not detected stays in its group.
            if history.last_group is not None:
                history.last_group.frames += 1
                history.last_group.confidence_sum += association.confidence

    def as_dict(self) -> dict[str, Any]:
        """Return the definition in plain values, as written to ``skill.yaml``.

        The error norms ``at_start`` and ``at_end`` are medians over the first and the last tenth of the frames that
        have an association. ``goal_tolerance`` is the norm of the goal error up to which an association is at its goal,
        None where no goal was learned. ``share`` is the fraction of all frames whose top association joins the same
        features.
        """
        members = {name: self._member(name, member) for name, member in self._members.items()}
        return {
            "degrees_of_freedom": sum(entry["constrains"] for entry in members.values()),
            "members": members,
        }

    def _member(self, name: str, member: KernelModel) -> dict[str, Any]:
        history = self._history[name]
        num_associated = len(history.errors)
        tenth = max(1, num_associated // 10)
        groups = sorted(history.groups, key=lambda group: -group.frames)
        digits = 6 if member.kernel.unit == "m" else 3
        return {
            "kernel": member.kernel.name,
            "meaning": member.kernel.meaning,
            "descriptor": member.descriptor,
            "error_rows": list(MemberStatus.lost(name, member).rows),
            "unit": member.kernel.unit,
            "learned": None if member.evidence is None else member.evidence.as_plain(),
            "goal_tolerance": round(float(member.goal.tolerance), digits) if member.goal.is_fitted else None,
            "constrains": constrained_freedom(member.kernel) if num_associated else 0,
            "frames": history.frames,
            "frames_with_association": num_associated,
            "mean_confidence": round(float(np.mean(history.confidences)), 4) if num_associated else None,
            "error_norm": {
                "at_start": round(float(np.median(history.errors[:tenth])), digits) if num_associated else None,
                "at_end": round(float(np.median(history.errors[-tenth:])), digits) if num_associated else None,
            },
            "associations": [
                {
                    "share": round(group.frames / history.frames, 4),
                    "mean_confidence": round(group.confidence_sum / group.frames, 4),
                    "seen_best_in_frame": group.best_frame,
                    "nodes": [node.as_json() for node in group.best.nodes],
                }
                for group in groups[:MAX_LISTED]
            ],
        }


def _matching_group(
    groups: list[_Group],
    descriptors: Sequence[Float32[np.ndarray, " _"]],
    association: Association,
    frame_index: int,
    orders: tuple[tuple[int, ...], ...],
) -> _Group:
    """Return the group most similar to the association, or a new one added to ``groups`` where none is similar enough.

    The similarity is that of the least similar pair of descriptors, in the best of the ``orders`` of the nodes. A group
    is represented by its most confident association.
    """
    matching, best_similarity = None, MIN_SIMILARITY
    for group in groups:
        for order in orders:
            pairs = zip((descriptors[node] for node in order), group.descriptors, strict=True)
            similarity = min(float(descriptor @ group_descriptor) for descriptor, group_descriptor in pairs)
            if similarity > best_similarity:
                matching, best_similarity = group, similarity
    if matching is None:
        matching = _Group(descriptors, association, frame_index)
        groups.append(matching)
    if association.confidence > matching.best.confidence:
        matching.descriptors, matching.best, matching.best_frame = descriptors, association, frame_index
    return matching
