"""Scores of one frame before selection: every instance of every member."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import final

import torch
from jaxtyping import Bool, Float, Int64
from torch import Tensor

from geoskill.features.feature_set import FeatureSet
from geoskill.graphs.motif_graph import MotifGraph, gather_nodes
from geoskill.kernels.kernel import automorphisms
from geoskill.model.confidence import confidences
from geoskill.model.kernel_model import KernelModel
from geoskill.skill.association import Association, InferenceResult, Node


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
    """

    name: str
    member: KernelModel
    graph: MotifGraph
    scores: Float[Tensor, " m"]
    select_out: Float[Tensor, " m"]

    def __len__(self) -> int:
        return len(self.scores)

    def best(self, count: int) -> list[int]:
        """Return the ``count`` instances of largest select-out, the largest first; all where there are fewer."""
        instances: list[int] = torch.topk(self.select_out, min(count, len(self))).indices.tolist()
        return instances

    @property
    def score_std(self) -> float:
        """Standard deviation of the scores; 0 without instances."""
        return float(self.scores.std(correction=0)) if len(self) else 0.0

    def penalized(self, instances: Bool[Tensor, " m"], by: float) -> "ScoredInstances":
        """Return a copy with ``by`` subtracted from the scores of ``instances``."""
        scores = self.scores - by * instances
        return replace(self, scores=scores, select_out=torch.softmax(scores, dim=0))

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

    def associations(self, instances: Sequence[int]) -> list[Association]:
        """Return these instances as associations, ranked in the order in which they are given."""
        chosen = torch.tensor(instances, device=self.scores.device, dtype=torch.long)
        index: Int64[Tensor, "k p"] = self.member.moving_node_first(self.graph, self.graph.instance_index[:, chosen])
        nodes = gather_nodes(self.member.kernel, self.member.attribute(self.graph, "geometry"), index)
        errors: Float[Tensor, "p d"] = self.member.kernel.control_error(nodes)
        confidence = confidences(self.scores, self.member.reference_margin)
        rows = zip(
            # Whole tensors become lists, since reading a tensor number by number is slow.
            confidence[chosen].tolist(),
            self.select_out[chosen].tolist(),
            zip(*(geometry.tolist() for geometry in nodes), strict=True),
            index.T.tolist(),
            errors.tolist(),
            strict=True,
        )
        roles = self.member.kernel.roles
        return [
            Association(
                member=self.name,
                kernel=self.member.kernel.name,
                descriptor=self.member.descriptor,
                rank=rank,
                confidence=own_confidence,
                weight=weight,
                nodes=tuple(
                    Node(role, tuple(xy), feature)
                    for role, xy, feature in zip(roles, coordinates, features, strict=True)
                ),
                error=tuple(error),
                unit=self.member.kernel.unit,
            )
            for rank, (own_confidence, weight, coordinates, features, error) in enumerate(rows, start=1)
        ]


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

    def result(self, selected: Mapping[str, Sequence[Association]]) -> InferenceResult:
        """Return the result of the frame, with a reason for every member that selects nothing.

        Args:
            selected: associations of each member by rank, by the member's name; empty for members without an instance.
        """
        associations: list[Association] = []
        reasons = {}
        for name, scored in self.members.items():
            associations.extend(selected[name])
            if not selected[name]:
                counts = ", ".join(
                    f"{len(self.features[extractor])} {node_type}s"
                    for node_type, extractor in scored.member.extractors.items()
                )
                reasons[name] = f"no instance: {counts} found"
        return InferenceResult(tuple(associations), self.features, reasons)
