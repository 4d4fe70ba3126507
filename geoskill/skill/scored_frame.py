"""What a skill makes of one frame before anything is selected: every instance of every member with its score."""

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
    """The instances of one member in one frame.

    Attributes:
        member: which one.
        graph: the frame.
        scores: ``[m]``, b of every instance.
        select_out: ``[m]``, g, the softmax of b.
    """

    member: KernelModel
    graph: MotifGraph
    scores: Float[Tensor, " m"]
    select_out: Float[Tensor, " m"]

    def __len__(self) -> int:
        return len(self.scores)

    def best(self, count: int) -> list[int]:
        """The instances of largest select-out, that first; no more than there are."""
        chosen: list[int] = torch.topk(self.select_out, min(count, len(self))).indices.tolist()
        return chosen

    @property
    def spread(self) -> float:
        """Standard deviation of the scores."""
        return float(self.scores.std(correction=0)) if len(self) else 0.0

    def penalized(self, instances: Bool[Tensor, " m"], by: float) -> "ScoredInstances":
        """The same with the scores of these instances penalized."""
        scores = self.scores - by * instances
        return replace(self, scores=scores, select_out=torch.softmax(scores, dim=0))

    def find(self, features: Sequence[int]) -> int | None:
        """The instance that joins these features, one for each role, in any order of those that are alike, or None."""
        index = self.graph.instance_index
        for order in automorphisms(self.member.kernel):
            wanted = torch.tensor([features[place] for place in order], device=index.device)
            (found,) = (index == wanted[:, None]).all(dim=0).nonzero(as_tuple=True)
            if len(found):
                return int(found[0])
        return None

    def associations(self, instances: Sequence[int]) -> list[Association]:
        """These instances as associations, ranked in the order in which they are given."""
        chosen = torch.tensor(instances, device=self.scores.device, dtype=torch.long)
        index: Int64[Tensor, "k p"] = self.member.moving_node_first(self.graph, self.graph.instance_index[:, chosen])
        nodes = gather_nodes(self.member.kernel, self.member.attribute(self.graph, "geometry"), index)
        errors: Float[Tensor, "p d"] = self.member.kernel.control_error(nodes)
        roles = self.member.kernel.roles
        sure = confidences(self.scores, self.member.reference_margin)
        return [
            Association(
                kernel=self.member.kernel.name,
                descriptor=self.member.descriptor,
                rank=row + 1,
                confidence=float(sure[instance]),
                weight=float(self.select_out[instance]),
                nodes=tuple(
                    Node(role, tuple(geometry[row].tolist()), int(feature))
                    for role, geometry, feature in zip(roles, nodes, index[:, row], strict=True)
                ),
                error=tuple(errors[row].tolist()),
                unit=self.member.kernel.unit,
            )
            for row, instance in enumerate(instances)
        ]


@final
@dataclass(frozen=True, eq=False)
class ScoredFrame:
    """One frame through the eyes of a skill.

    Attributes:
        features: what each extractor found, by the extractor's name.
        members: by name; some may be without any instance.
    """

    features: Mapping[str, FeatureSet]
    members: Mapping[str, ScoredInstances]

    def result(self, selected: Mapping[str, Sequence[Association]]) -> InferenceResult:
        """What is selected of it.

        Args:
            selected: associations of each member, by rank; none for those without an instance.
        """
        associations: list[Association] = []
        reasons = {}
        for name, scored in self.members.items():
            associations.extend(selected[name])
            if not selected[name]:
                extractors = scored.member.extractors
                found = ", ".join(f"{len(self.features[extractor])} {kind}s" for kind, extractor in extractors.items())
                reasons[scored.member.kernel.name, scored.member.descriptor] = f"no instance: {found} found"
        return InferenceResult(tuple(associations), self.features, reasons)
