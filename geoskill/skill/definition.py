"""Readable definition of a task: associated features, confidence, and constrained degrees of freedom.

What of it a person may edit, and how an edited one is read, is in :mod:`geoskill.skill.definition_edit`.
"""

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, final

import numpy as np
from jaxtyping import Float32, UInt8

from geoskill.kernels.kernel import Kernel, automorphisms, constrained_freedom
from geoskill.model.kernel_model import KernelModel
from geoskill.skill.association import Association, InferenceResult, Node
from geoskill.skill.crops import Crop, crop_around
from geoskill.skill.definition_edit import shown_tolerance
from geoskill.skill.member_status import MemberStatus
from geoskill.skill.phases import phases_of
from geoskill.skill.pin import MIN_SIMILARITY, encoded_descriptor
from geoskill.skill.scored_frame import node_roles
from geoskill.skill.sentences import constraint_sentence, task_sentence

# Groups of associations listed for each member.
MAX_LISTED = 5
# Groups of a member of which crops are kept while a video is seen; those of the rarest ones are forgotten.
MAX_CROPPED = 32
FOLDER = "definition"
"""Of the pictures, beside the definition."""


@final
@dataclass(eq=False)
class _Group:
    """Top associations of several frames that join the same features."""

    descriptors: Sequence[Float32[np.ndarray, " _"]]
    best: Association
    best_frame: int
    crops: tuple[Crop, ...] = ()
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

    def add(
        self, frame_index: int, result: InferenceResult, image: UInt8[np.ndarray, "height width 3"] | None = None
    ) -> None:
        """Add the result of one frame.

        Args:
            frame_index: its number.
            result: what was selected in it.
            image: the frame, RGB, from which crops are taken; None for none.
        """
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
                if image is not None and history.last_group.best is association:
                    history.last_group.crops = tuple(crop_around(image, node) for node in association.nodes)
                    _forget_rare_crops(history)
            # An association kept over a frame in which one of its features is not detected stays in its group.
            if history.last_group is not None:
                history.last_group.frames += 1
                history.last_group.confidence_sum += association.confidence

    def as_dict(self) -> dict[str, Any]:
        """Return the definition in plain values, as written to ``skill.yaml``.

        The error norms ``at_start`` and ``at_end`` are medians over the first and the last tenth of the frames that
        have an association. ``goal_tolerance`` is the norm of the goal error up to which an association is at its goal,
        None where no goal was learned. ``share`` is the fraction of all frames whose top association joins the same
        features. ``phases`` are those of the demonstration (:meth:`~geoskill.skill.phases.Phase.as_plain`). ``pin`` is
        the number of one of the associations, if only that is to be selected. ``descriptors`` are those of the nodes
        of the associations, in their order (:mod:`geoskill.skill.pin`).
        """
        members = {name: self._member(name, member) for name, member in self._members.items()}
        return {
            "task": task_sentence(_stages(self._members)),
            "degrees_of_freedom": sum(entry["constrains"] for entry in members.values()),
            "phases": [phase.as_plain() for phase in phases_of(self._members)],
            "members": members,
            "descriptors": {
                name: [[encoded_descriptor(own) for own in group.descriptors] for group in self._listed(name)]
                for name in self._members
            },
        }

    def pictures(self) -> Iterator[tuple[str, Crop, Node]]:
        """Yield the crops that the definition names, with their paths relative to it and the node in each."""
        for name in self._members:
            for number, group in enumerate(self._listed(name), start=1):
                # Without a crop there is no path either.
                yield from zip(_picture_paths(name, number, group), group.crops, group.best.nodes, strict=False)

    def _listed(self, name: str) -> list[_Group]:
        """Return the groups of a member that are listed, those of most frames first."""
        return sorted(self._history[name].groups, key=lambda group: -group.frames)[:MAX_LISTED]

    def _member(self, name: str, member: KernelModel) -> dict[str, Any]:
        history = self._history[name]
        num_associated = len(history.errors)
        tenth = max(1, num_associated // 10)
        digits = 6 if member.kernel.unit == "m" else 3
        confidence = round(float(np.mean(history.confidences)), 4) if num_associated else None
        tolerance = shown_tolerance(member) if member.goal.is_fitted else None
        return {
            "sentence": constraint_sentence(member.kernel, node_roles(member), tolerance, confidence, _found(member)),
            "kernel": member.kernel.name,
            "meaning": member.kernel.meaning,
            "descriptor": member.descriptor,
            "error_rows": list(MemberStatus.lost(name, member).rows),
            "unit": member.kernel.unit,
            "learned": None if member.evidence is None else member.evidence.as_plain(),
            "goal_tolerance": tolerance,
            "pin": None,
            "constrains": constrained_freedom(member.kernel) if num_associated else 0,
            "frames": history.frames,
            "frames_with_association": num_associated,
            "mean_confidence": confidence,
            "error_norm": {
                "at_start": round(float(np.median(history.errors[:tenth])), digits) if num_associated else None,
                "at_end": round(float(np.median(history.errors[-tenth:])), digits) if num_associated else None,
            },
            "associations": [
                {
                    "number": number,
                    "share": round(group.frames / history.frames, 4),
                    "mean_confidence": round(group.confidence_sum / group.frames, 4),
                    "seen_best_in_frame": group.best_frame,
                    "nodes": _described_nodes(name, number, group),
                }
                for number, group in enumerate(self._listed(name), start=1)
            ],
        }


def _stages(members: Mapping[str, KernelModel]) -> list[list[Kernel]]:
    """Return the kernels of what was learned, by phase; those of which it is not known when they settle come last."""
    found = {name: member.kernel for name, member in members.items() if _found(member)}
    phases = [phase.settling for phase in phases_of(members)]
    known = {name for settling in phases for name in settling}
    stages = [[found[name] for name in settling if name in found] for settling in phases]
    return [*stages, [kernel for name, kernel in found.items() if name not in known]]


def _found(member: KernelModel) -> bool:
    """Return whether something was learned, as far as that is known."""
    return member.evidence is None or member.evidence.found


def _described_nodes(member: str, number: int, group: _Group) -> list[dict[str, Any]]:
    nodes = [node.as_json() for node in group.best.nodes]
    for node, path in zip(nodes, _picture_paths(member, number, group), strict=False):
        node["picture"] = path
    return nodes


def _picture_paths(member: str, number: int, group: _Group) -> list[str]:
    """Return where the crops of a group belong, named by role, such as ``definition/p2p_sift-1-moving.png``."""
    if not group.crops:
        return []
    names = [str(node.role or "node") for node in group.best.nodes]
    counts = Counter(names)
    names = [name if counts[name] == 1 else f"{name}{place}" for place, name in enumerate(names, start=1)]
    return [f"{FOLDER}/{member}-{number}-{name}.png" for name in names]


def _forget_rare_crops(history: _MemberHistory) -> None:
    cropped = [group for group in history.groups if group.crops]
    if len(cropped) > MAX_CROPPED:
        rarest = min(cropped, key=lambda group: (group is history.last_group, group.frames))
        rarest.crops = ()


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
