"""Augmentation of features in training: one video shows a feature in one light, from one side and never hidden."""

import math
from collections.abc import Sequence

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from geoskill.geometry.primitives import NodeType
from geoskill.graphs.motif_graph import MotifGraph


def noisy(descriptors: Float[Tensor, "n d"], strength: float, generator: torch.Generator) -> Float[Tensor, "n d"]:
    """Return unit-norm descriptors with Gaussian noise whose expected squared norm is ``strength`` squared.

    The SD of one component is ``strength / sqrt(d)``, so one value means the same for descriptors of any length.
    """
    noise = torch.randn(descriptors.shape, generator=generator, device=descriptors.device, dtype=descriptors.dtype)
    return descriptors + noise * (strength / math.sqrt(descriptors.shape[1]))


def sample_visible(
    graph: MotifGraph,
    node_types: Sequence[NodeType],
    dropout: float,
    max_visible: int | None,
    generator: torch.Generator,
) -> dict[NodeType, Bool[Tensor, " n"]]:
    """Draw the features of a graph or batch that take part in a step; all others are hidden, as if occluded.

    The skill thus learns which association is right when the best one is not visible. And a step does not take longer
    with more features, since it uses a random few of them.

    Args:
        graph: one frame or a batch of frames.
        node_types: the types of features.
        dropout: probability with which a feature is hidden.
        max_visible: limit of the expected number of visible features of each type in a frame; None for no limit.
        generator: of the draws.

    Returns:
        For each node type, whether a feature is visible.
    """
    visible = {}
    for node_type in node_types:
        counts = graph[f"{node_type}_count"]
        hidden = torch.full_like(counts, dropout, dtype=torch.float32)
        if max_visible is not None:
            hidden = torch.maximum(hidden, 1 - max_visible / counts.clamp_min(1))
        draws = torch.rand(int(counts.sum()), generator=generator, device=generator.device)
        visible[node_type] = draws >= hidden.repeat_interleave(counts)
    return visible
