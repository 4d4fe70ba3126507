"""What training disturbs: a single video shows each feature under one light, from one side, and never hidden."""

import copy
import math

import torch
from jaxtyping import Float
from torch import Tensor

from geoskill.geometry.primitives import NodeType
from geoskill.graphs.motif_graph import MotifGraph


def noisy(descriptors: Float[Tensor, "n d"], strength: float, generator: torch.Generator) -> Float[Tensor, "n d"]:
    """Unit-norm descriptors with Gaussian noise whose expected squared norm is ``strength`` squared.

    The SD of one component is ``strength / sqrt(d)``, so one value means the same for descriptors of any length.
    """
    noise = torch.randn(descriptors.shape, generator=generator, device=descriptors.device, dtype=descriptors.dtype)
    return descriptors + noise * (strength / math.sqrt(descriptors.shape[1]))


def with_hidden_features(graph: MotifGraph, share: float, generator: torch.Generator) -> MotifGraph:
    """A graph or batch in which each feature is hidden with probability ``share``: without the instances that have it.

    The skill must then know which association is right when the best one cannot be seen, and a step has only
    ``(1 - share) ** k`` of the instances to score. A frame may be left without any.
    """
    # A batch lists the roles of each of its frames.
    roles = graph.roles[0] if isinstance(graph.roles, list) else graph.roles
    visible = {}
    for role in dict.fromkeys(roles):
        count = graph.node_count(NodeType(role))
        visible[role] = torch.rand(count, generator=generator, device=generator.device) >= share
    kept = torch.stack([visible[role][row] for role, row in zip(roles, graph.instance_index, strict=True)]).all(dim=0)
    reduced = copy.copy(graph)
    reduced.instance_index = graph.instance_index[:, kept]
    reduced.instance_frame = graph.instance_frame[kept]
    return reduced
