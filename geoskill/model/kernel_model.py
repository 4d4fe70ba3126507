"""A skill kernel with its network: the select-out function and what was fitted with it."""

from collections.abc import Mapping
from typing import final

import torch
from jaxtyping import Float, Int64
from torch import Tensor, nn

from geoskill.geometry.primitives import NodeType
from geoskill.graphs.motif_graph import MotifGraph, gather_nodes
from geoskill.kernels.kernel import Kernel, automorphisms, node_types
from geoskill.model.scorer import InstanceScorer


@final
class KernelModel(nn.Module):
    """One member of a skill.

    Args:
        kernel: the motif and its control error.
        extractors: the name of the extractor that feeds each node type.
        scorer: the network built for this motif.

    Attributes:
        spans: ``[s]``, the lengths in frames of the transitions it was trained on; empty before training.
        beta: ``[s]``, the reward's scale for each of them, fitted to the demonstration.
        node_order: ``[d]``, its product with the descriptor of one node is larger than with that of another that the motif
            does not tell apart, when the one moves to the other; empty before training, and where the motif tells all
            nodes apart.
        reference_margin: how far the best score of a frame is ahead in the demonstration; 0 before training
            (:mod:`geoskill.model.confidence`). All four are buffers, so that a checkpoint holds them.

    Raises:
        ValueError: when a node type of the kernel has no extractor.
    """

    spans: Tensor
    beta: Tensor
    node_order: Tensor
    reference_margin: Tensor

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

    def set_reward_scale(self, spans: Tensor, beta: Tensor) -> None:
        """Keep what was fitted to the demonstration."""
        if spans.shape != beta.shape:
            raise ValueError(f"{len(beta)} values of beta for {len(spans)} spans; expected as many")
        self.spans, self.beta = spans.to(self.spans), beta.to(self.beta)

    def set_node_order(self, node_order: Float[Tensor, " d"]) -> None:
        """Keep what was fitted to the demonstration."""
        self.node_order = node_order.to(self.node_order)

    def set_reference_margin(self, reference_margin: Float[Tensor, ""]) -> None:
        """Keep what was fitted to the demonstration."""
        self.reference_margin = reference_margin.to(self.reference_margin)

    def moving_node_first(self, graph: MotifGraph, instances: Int64[Tensor, "k p"]) -> Int64[Tensor, "k p"]:
        """Instances of a frame with their nodes in the order, of those that the motif does not tell apart, in which
        the node that moved in the demonstration comes first; the sign of the control error follows it.
        """
        orders = automorphisms(self.kernel)
        if len(orders) == 1 or len(self.node_order) == 0:
            return instances
        role = self.kernel.roles[0]
        moves = self.attribute(graph, "descriptor")[role] @ self.node_order
        best = torch.stack([moves[instances[order[0]]] for order in orders]).argmax(dim=0)
        listed = torch.stack([instances[list(order)] for order in orders])
        return listed[best, :, torch.arange(instances.shape[1], device=instances.device)].T

    def _load_from_state_dict(self, state_dict: dict[str, Tensor], prefix: str, *args: object) -> None:
        # Their lengths depend on the demonstration and on its descriptors, so the stored shape rules.
        for name in ("spans", "beta", "node_order"):
            if prefix + name in state_dict:
                own = getattr(self, name)
                setattr(self, name, own.new_empty(state_dict[prefix + name].shape))
        super()._load_from_state_dict(state_dict, prefix, *args)

    @property
    def descriptor(self) -> str:
        """The names of its extractors, such as ``sift`` or ``sift+lbd``."""
        return "+".join(self.extractors.values())

    @property
    def node_types(self) -> tuple[NodeType, ...]:
        """The distinct types of the kernel's nodes."""
        return node_types(self.kernel)

    def forward(
        self, graph: MotifGraph, descriptors: Mapping[NodeType, Float[Tensor, "n _"]] | None = None
    ) -> Float[Tensor, " m"]:
        """Scores of all instances of a graph or a batch of graphs, in float32 whatever the precision inside.

        Args:
            graph: one frame or a batch of frames.
            descriptors: take these in place of the graph's own (noisy ones, in training).
        """
        given = descriptors if descriptors is not None else self.attribute(graph, "descriptor")
        scores: Tensor = self.scorer(given, graph.instance_index)
        return scores.float()

    def attribute(self, graph: MotifGraph, name: str) -> dict[NodeType, Tensor]:
        """A per-feature attribute (``descriptor``, ``geometry``, ``next_geometry``, ``tracked``) by node type."""
        return {node_type: graph[f"{node_type}_{name}"] for node_type in self.node_types}

    def control_errors(self, graph: MotifGraph, geometry: str = "geometry") -> Float[Tensor, "m d"]:
        """The control error of every instance, from the features' own or their ``next_geometry``."""
        nodes = gather_nodes(self.kernel, self.attribute(graph, geometry), graph.instance_index)
        return self.kernel.control_error(nodes)
