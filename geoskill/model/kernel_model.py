"""A skill kernel with its network: the select-out function and what was fitted with it."""

from collections.abc import Mapping
from typing import final

import torch
from jaxtyping import Float
from torch import Tensor, nn

from geoskill.geometry.primitives import NodeType
from geoskill.graphs.motif_graph import MotifGraph, gather_nodes
from geoskill.kernels.kernel import Kernel, node_types
from geoskill.model.scorer import InstanceScorer


@final
class KernelModel(nn.Module):
    """One member of a skill.

    Args:
        kernel: the motif and its control error.
        scorer: the network built for this motif.

    Attributes:
        beta: the reward's scale, fitted to the demonstration before training; NaN until then. A buffer, so that a
            checkpoint holds it.
    """

    beta: Tensor

    def __init__(self, kernel: Kernel, scorer: InstanceScorer) -> None:
        super().__init__()
        self.kernel = kernel
        self.scorer = scorer
        self.register_buffer("beta", torch.tensor(float("nan")))

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
        """A per-feature attribute (``descriptor``, ``geometry``, ``moved``, ``followed``) by node type."""
        return {node_type: graph[f"{node_type}_{name}"] for node_type in self.node_types}

    def control_errors(self, graph: MotifGraph, geometry: str = "geometry") -> Float[Tensor, "m d"]:
        """The control error of every instance, from the features' own or their ``moved`` geometry."""
        nodes = gather_nodes(self.kernel, self.attribute(graph, geometry), graph.instance_index)
        return self.kernel.control_error(nodes)
