"""Scores of one frame before selection: every instance of every member."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import final

import torch
from jaxtyping import Bool, Float, Int64
from torch import Tensor

from geoskill.features.feature_set import FeatureSet
from geoskill.geometry.depth_camera import DepthCamera
from geoskill.geometry.primitives import NodeType
from geoskill.geometry.uncertainty import propagated_std
from geoskill.graphs.motif_graph import MotifGraph, gather_nodes
from geoskill.kernels.kernel import automorphisms, directed_nodes, turned_lines
from geoskill.model.confidence import confidences
from geoskill.model.kernel_model import KernelModel
from geoskill.skill.association import Association, Goal, InferenceResult, Node, NodeRole
from geoskill.skill.consensus import consensus
from geoskill.skill.goal import GoalFinder
from geoskill.skill.goal_in_space import SpaceGoalFinder
from geoskill.skill.member_status import MemberStatus, State


@final
@dataclass(frozen=True, eq=False)
class ScoredInstances:
    """All instances of one member in one frame, with their scores.

    Attributes:
        name: name of the member.
        member: kernel and network.
        graph: graph of the frame.
        scores: ``[m]``, score b of every instance.
        select_out: ``[m]``, select-out g of every instance, the softmax of b.
        camera: intrinsics of the frame, for members in space; None where their goals need not be shown.
        allowed: ``[m]``, which instances may be selected; None for all (:mod:`geoskill.skill.pin`).
    """

    name: str
    member: KernelModel
    graph: MotifGraph
    scores: Float[Tensor, " m"]
    select_out: Float[Tensor, " m"]
    camera: DepthCamera | None = None
    allowed: Bool[Tensor, " m"] | None = None

    def __len__(self) -> int:
        return len(self.scores)

    def best(self, count: int) -> list[int]:
        """Return the ``count`` allowed instances of largest select-out, the largest first; fewer if there are fewer."""
        select_out, available = self.select_out, len(self)
        if self.allowed is not None:
            select_out, available = torch.where(self.allowed, select_out, -1.0), int(self.allowed.sum())
        instances: list[int] = torch.topk(select_out, min(count, available)).indices.tolist()
        return instances

    @property
    def score_std(self) -> float:
        """Standard deviation of the scores; 0 without instances."""
        return float(self.scores.std(correction=0)) if len(self) else 0.0

    def penalized(self, instances: Bool[Tensor, " m"], by: float) -> "ScoredInstances":
        """Return a copy with ``by`` subtracted from the scores of ``instances``."""
        scores = self.scores - by * instances
        return replace(self, scores=scores, select_out=torch.softmax(scores, dim=0))

    @cached_property
    def _goal_finder(self) -> GoalFinder:
        return GoalFinder(self.member, self.graph)

    @cached_property
    def _space_goal_finder(self) -> SpaceGoalFinder:
        return SpaceGoalFinder(self.member, self.graph, self.camera)

    def _goals(
        self, features: Sequence[Sequence[int]], nodes: Sequence[Sequence[Node]], axis: Float[Tensor, "2"]
    ) -> list[Goal | None]:
        if self.member.kernel.in_space:
            return self._space_goal_finder.goals(features, nodes)
        return self._goal_finder.goals(features, nodes, axis)

    def find(self, features: Sequence[int]) -> int | None:
        """Return the instance that joins these features, or None.

        Args:
            features: one for each role, in any order that the motif does not tell apart.
        """
        index = self.graph.instance_index
        for order in automorphisms(self.member.kernel):
            permuted = torch.tensor([features[role] for role in order], device=index.device)
            (matches,) = (index == permuted[:, None]).all(dim=0).nonzero(as_tuple=True)
            if len(matches):
                return int(matches[0])
        return None

    def associations(self, instances: Sequence[int], axis: Float[Tensor, "2"] | None = None) -> list[Association]:
        """Return these instances as associations, ranked in the order in which they are given.

        Args:
            instances: of this frame.
            axis: the direction by which segments are directed; None for that of the member.
        """
        index = self.graph.instance_index[:, self._chosen(instances)]
        return self._associations(instances, self.member.moving_node_first(self.graph, index), axis)

    def association(
        self, instance: int, features: Sequence[int], axis: Float[Tensor, "2"] | None = None
    ) -> Association:
        """Return an instance as an association of rank 1, with its nodes in a given order.

        Args:
            instance: of this frame.
            features: those that it joins, one for each role, in an order that the motif does not tell apart.
            axis: the direction by which segments are directed; None for that of the member.
        """
        index = torch.tensor(features, device=self.graph.instance_index.device)[:, None]
        return self._associations([instance], index, axis)[0]

    def _chosen(self, instances: Sequence[int]) -> Int64[Tensor, " p"]:
        return torch.tensor(instances, device=self.scores.device, dtype=torch.long)

    def _associations(
        self, instances: Sequence[int], index: Int64[Tensor, "k p"], axis: Float[Tensor, "2"] | None
    ) -> list[Association]:
        """Return instances, whose features are given in the order of their nodes, as associations."""
        member, kernel = self.member, self.member.kernel
        chosen = self._chosen(instances)
        axis = member.reference_axis if axis is None else axis
        detected = gather_nodes(kernel, member.attribute(self.graph, "geometry"), index)
        nodes = directed_nodes(kernel, detected, axis.to(index.device)[None])
        places, covariances = nodes, None
        if kernel.in_space:
            places, covariances = self._in_space(index, turned_lines(detected, nodes))
        errors: Float[Tensor, "p d"] = kernel.control_error(places)
        reliance = 1.0 if member.evidence is None else member.evidence.reliance
        confidence = reliance * confidences(self.scores, member.reference_margin, member.reference_level)
        node_lists = _node_lists(member, nodes, index, None if covariances is None else (places, covariances))
        rows = zip(
            # Whole tensors become lists, since reading a tensor number by number is slow.
            confidence[chosen].tolist(),
            self.select_out[chosen].tolist(),
            node_lists,
            errors.tolist(),
            propagated_std(kernel.control_error, places, covariances).tolist(),
            self._goals(index.T.tolist(), node_lists, axis),
            strict=True,
        )
        return [
            Association(
                member=self.name,
                kernel=kernel.name,
                descriptor=member.descriptor,
                rank=rank,
                confidence=own_confidence,
                weight=weight,
                nodes=own_nodes,
                error=tuple(error),
                unit=kernel.unit,
                error_std=tuple(std),
                goal=goal,
            )
            for rank, (own_confidence, weight, own_nodes, error, std, goal) in enumerate(rows, start=1)
        ]

    def _in_space(
        self, index: Int64[Tensor, "k p"], turned: Sequence[Bool[Tensor, " p"]]
    ) -> tuple[list[Float[Tensor, "p _"]], list[Float[Tensor, "p _ _"]]]:
        """Return the nodes of instances in space, the ends of some lines exchanged, and their covariances."""
        kernel = self.member.kernel
        places = gather_nodes(kernel, self.member.attribute(self.graph, "space"), index)
        covariances = gather_nodes(kernel, self.member.attribute(self.graph, "space_covariance"), index)
        for node, role in enumerate(kernel.roles):
            if role is NodeType.LINE:
                mask = turned[node][:, None]
                places[node] = torch.where(mask, places[node].roll(3, dims=1), places[node])
                exchanged = covariances[node].roll((3, 3), dims=(1, 2))
                covariances[node] = torch.where(mask[..., None], exchanged, covariances[node])
        return places, covariances


def _node_lists(
    member: KernelModel,
    nodes: Sequence[Float[Tensor, "p _"]],
    index: Int64[Tensor, "k p"],
    in_space: tuple[Sequence[Float[Tensor, "p _"]], Sequence[Float[Tensor, "p _ _"]]] | None,
) -> list[tuple[Node, ...]]:
    """Return the nodes of each instance; with their places in space and the covariances of these, where given."""
    by_role = []
    for node, (node_type, role) in enumerate(zip(member.kernel.roles, node_roles(member), strict=True)):
        rows = [nodes[node].tolist(), index[node].tolist()]
        rows += [[None] * index.shape[1]] * 2 if in_space is None else [own[node].tolist() for own in in_space]
        by_role.append(
            [
                Node(
                    node_type,
                    tuple(xy),
                    feature,
                    role,
                    space and tuple(space),
                    covariance and tuple(map(tuple, covariance)),
                )
                for xy, feature, space, covariance in zip(*rows, strict=True)
            ]
        )
    return list(zip(*by_role, strict=True))


def node_roles(member: KernelModel) -> list[NodeRole | None]:
    """Return the role of each node of an association that is listed with the moving node first; None if not known."""
    if len(member.goal.moving) == 0:
        return [None] * len(member.kernel.roles)
    return [NodeRole.MOVING if moves else NodeRole.RESTING for moves in member.goal.moving.tolist()]


@final
@dataclass(frozen=True, eq=False)
class ScoredFrame:
    """Features and scores of one frame.

    Attributes:
        features: detected features, by the extractor's name.
        members: scored instances, by the member's name; a member may have no instance.
    """

    features: Mapping[str, FeatureSet]
    members: Mapping[str, ScoredInstances]

    def result(
        self, selected: Mapping[str, Sequence[Association]], statuses: Mapping[str, MemberStatus] | None = None
    ) -> InferenceResult:
        """Return the result of the frame, with a reason for every member that selects nothing.

        Args:
            selected: associations of each member by rank, by the member's name; empty for members without an instance.
            statuses: of the members; None for what their top associations say by themselves.
        """
        if statuses is None:
            statuses = {name: self.status(name, selected[name]) for name in self.members}
        associations: list[Association] = []
        reasons = {}
        for name, scored in self.members.items():
            associations.extend(selected[name])
            if not selected[name]:
                counts = ", ".join(
                    f"{len(self.features[extractor])} {node_type}s"
                    for node_type, extractor in scored.member.extractors.items()
                )
                pinned = scored.allowed is not None and len(scored) > 0
                reasons[name] = "the pinned association is not visible" if pinned else f"no instance: {counts} found"
        return InferenceResult(tuple(associations), self.features, reasons, statuses)

    def status(self, name: str, listed: Sequence[Association]) -> MemberStatus:
        """Return the status of a member by its top association in this frame alone.

        Args:
            name: of the member.
            listed: its associations by rank.
        """
        member = self.members[name].member
        if not listed:
            return MemberStatus.lost(name, member)
        agreed = consensus(member.kernel, listed)
        return replace(
            MemberStatus.lost(name, member),
            state=State.AT_GOAL if listed[0].is_at_goal else State.APPROACHING,
            error_is_certain=True,
            goal_error_is_certain=listed[0].goal is not None,
            agreement=None if agreed is None else agreed.share,
            offset_px=None if agreed is None else agreed.offset_px,
        )
