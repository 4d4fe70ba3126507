"""A skill kernel with its network, which together make one member of a skill."""

from collections.abc import Mapping
from dataclasses import astuple
from typing import Final, final

import torch
from jaxtyping import Float, Int64
from torch import Tensor, nn

from geoskill.control.settling import Settling
from geoskill.geometry.primitives import NodeType
from geoskill.graphs.motif_graph import MotifGraph, gather_nodes
from geoskill.kernels.kernel import Kernel, automorphisms, node_types
from geoskill.model.evidence import Evidence
from geoskill.model.goal_reference import GoalReference
from geoskill.model.scorer import InstanceScorer

IN_SPACE: Final = {
    "geometry": "space",
    "next_geometry": "next_space",
    "anchor_xy": "anchor_space",
    "final_xy": "final_space",
}
"""Attributes of a graph's features in the picture, and the same in space."""


@final
class KernelModel(nn.Module):
    """One member of a skill: a kernel, its scorer, and what was fitted to the demonstration.

    Args:
        kernel: the motif and its control error.
        extractors: the name of the extractor that feeds each node type.
        scorer: the network built for this motif.

    Attributes:
        spans: ``[s]``, the lengths in frames of the transitions it was trained on; empty before training.
        beta: ``[s]``, the reward's scale for each span, in the inverse of the unit of the changes.
        node_order: ``[d]``, a regression vector. Of two nodes that the motif does not tell apart, the one whose
            descriptor has the larger product with it is taken to move to the other. Empty before training, and when
            the motif tells all nodes apart.
        reference_margin: the median margin of the best score in the frames of the demonstration; 0 before training
            (:mod:`geoskill.model.confidence`).
        level_values: ``[1]``, that of :attr:`reference_level`; empty before training.
        reference_axis: ``[2]``, the direction by which segments are directed (:func:`directed_nodes`), of unit length;
            to the right before training.
        evidence_values: ``[3]``, those of :attr:`evidence`; empty before training.
        settling_values: ``[3]``, those of :attr:`settling`; empty before training, and where it is not known. All eight
            are buffers, so that a checkpoint holds them.
        goal: what is known of the end of the demonstration.

    Raises:
        ValueError: when the extractors are not those of the kernel's node types.
    """

    spans: Tensor
    beta: Tensor
    node_order: Tensor
    reference_margin: Tensor
    level_values: Tensor
    reference_axis: Tensor
    evidence_values: Tensor
    settling_values: Tensor

    def __init__(self, kernel: Kernel, extractors: Mapping[NodeType, str], scorer: InstanceScorer) -> None:
        super().__init__()
        if set(extractors) != set(kernel.roles):
            raise ValueError(f"{kernel.name} has extractors for {sorted(extractors)}; expected {sorted(kernel.roles)}")
        self.kernel = kernel
        self.extractors = {node_type: extractors[node_type] for node_type in node_types(kernel)}
        self.scorer = scorer
        self.register_buffer("spans", torch.zeros(0, dtype=torch.long))
        self.register_buffer("beta", torch.zeros(0))
        self.register_buffer("node_order", torch.zeros(0))
        self.register_buffer("reference_margin", torch.zeros(()))
        self.register_buffer("level_values", torch.zeros(0))
        self.register_buffer("reference_axis", torch.tensor([1.0, 0.0]))
        self.register_buffer("evidence_values", torch.zeros(0))
        self.register_buffer("settling_values", torch.zeros(0))
        self.goal = GoalReference(kernel)

    def set_reward_scale(self, spans: Tensor, beta: Tensor) -> None:
        """Set the reward's scale for each span of time.

        Raises:
            ValueError: when there are not as many values of beta as spans.
        """
        if spans.shape != beta.shape:
            raise ValueError(f"{len(beta)} values of beta for {len(spans)} spans; expected as many")
        self.spans, self.beta = spans.to(self.spans), beta.to(self.beta)

    def set_node_order(self, node_order: Float[Tensor, " d"]) -> None:
        """Set the regression vector of :meth:`moving_node_first`."""
        self.node_order = node_order.to(self.node_order)

    def set_reference_margin(
        self, reference_margin: Float[Tensor, ""], reference_level: Float[Tensor, ""] | None = None
    ) -> None:
        """Set the margin to which confidences are relative, and the level above which scores must be."""
        self.reference_margin = reference_margin.to(self.reference_margin)
        self.level_values = self.level_values.new_tensor([] if reference_level is None else [float(reference_level)])

    @property
    def reference_level(self) -> Float[Tensor, ""] | None:
        """The median over the demonstration's frames of the mean score; None before training."""
        return self.level_values[0] if len(self.level_values) else None

    def set_reference_axis(self, reference_axis: Float[Tensor, "2"]) -> None:
        """Set the direction by which segments are directed."""
        self.reference_axis = reference_axis.to(self.reference_axis)

    @property
    def evidence(self) -> Evidence | None:
        """What the demonstration says of what was learned from it; None before training is finished."""
        values = self.evidence_values.tolist()
        return Evidence(*values) if values else None

    def set_evidence(self, evidence: Evidence) -> None:
        """Set what the demonstration says of what was learned from it."""
        self.evidence_values = self.evidence_values.new_tensor(astuple(evidence))

    @property
    def settling(self) -> Settling | None:
        """When the selected associations settle in the demonstration; None where that is not known."""
        values = self.settling_values.tolist()
        return Settling(*values) if values else None

    def set_settling(self, settling: Settling) -> None:
        """Set when the selected associations settle in the demonstration."""
        self.settling_values = self.settling_values.new_tensor(astuple(settling))

    def moving_node_first(self, graph: MotifGraph, instances: Int64[Tensor, "k p"]) -> Int64[Tensor, "k p"]:
        """List the nodes of each instance of a frame so that the node that moved in the demonstration comes first.

        Only nodes that the motif does not tell apart are exchanged. The sign of the control error depends on the order.
        """
        orders = automorphisms(self.kernel)
        if len(orders) == 1 or len(self.node_order) == 0:
            return instances
        role = self.kernel.roles[0]
        motion_scores = self.attribute(graph, "descriptor")[role] @ self.node_order
        # The earlier in the order, the more a node counts: of four alike, all are in the order of their motion.
        best = torch.stack(
            [
                torch.stack(
                    [
                        (len(order) - 1 - place) * motion_scores[instances[node]]
                        for place, node in enumerate(order)
                        if self.kernel.roles[node] is role
                    ]
                ).sum(dim=0)
                for order in orders
            ]
        ).argmax(dim=0)
        listed = torch.stack([instances[list(order)] for order in orders])
        return listed[best, :, torch.arange(instances.shape[1], device=instances.device)].T

    def _load_from_state_dict(self, state_dict: dict[str, Tensor], prefix: str, *args: object) -> None:
        # The lengths of these buffers depend on the demonstration and its descriptors, so the stored shape rules.
        state_dict.setdefault(f"{prefix}level_values", self.level_values.new_empty(0))  # added within format 5
        for name in ("spans", "beta", "node_order", "level_values", "evidence_values", "settling_values"):
            if prefix + name in state_dict:
                buffer = getattr(self, name)
                setattr(self, name, buffer.new_empty(state_dict[prefix + name].shape))
        super()._load_from_state_dict(state_dict, prefix, *args)

    @property
    def descriptor(self) -> str:
        """The names of the extractors, such as ``sift`` or ``sift+lbd``."""
        return "+".join(self.extractors.values())

    @property
    def node_types(self) -> tuple[NodeType, ...]:
        """The distinct types of the kernel's nodes."""
        return node_types(self.kernel)

    def forward(
        self, graph: MotifGraph, descriptors: Mapping[NodeType, Float[Tensor, "n _"]] | None = None
    ) -> Float[Tensor, " m"]:
        """Return the scores of all instances of a graph or a batch of graphs, in float32 whatever the precision inside.

        Args:
            graph: one frame or a batch of frames.
            descriptors: replace those of the graph (noisy ones, in training); None for the graph's.
        """
        if descriptors is None:
            descriptors = self.attribute(graph, "descriptor")
        scores: Tensor = self.scorer(descriptors, graph.instance_index)
        return scores.float()

    def attribute(self, graph: MotifGraph, name: str) -> dict[NodeType, Tensor]:
        """Return a per-feature attribute, such as ``descriptor`` or ``next_geometry``, by node type."""
        return {node_type: graph[f"{node_type}_{name}"] for node_type in self.node_types}

    def places(self, graph: MotifGraph, name: str = "geometry") -> dict[NodeType, Tensor]:
        """Return what the kernel's control error is given of each feature, by node type.

        Args:
            graph: one frame or a batch of frames.
            name: ``geometry``, ``next_geometry``, ``anchor_xy`` or ``final_xy``; for a kernel in space, that in space.
        """
        return self.attribute(graph, IN_SPACE[name] if self.kernel.in_space else name)

    def control_errors(self, graph: MotifGraph, name: str = "geometry") -> Float[Tensor, "m d"]:
        """Return the control error of every instance, with its nodes at these places (:meth:`places`).

        In space it is NaN where depth is missing, which is never so for ``geometry``.
        """
        nodes = gather_nodes(self.kernel, self.places(graph, name), graph.instance_index)
        return self.kernel.control_error(nodes)
