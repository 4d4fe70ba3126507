"""What training disturbs: a single video shows each feature under one light, from one side, and never hidden."""

import math
from collections.abc import Sequence

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from geoskill.geometry.primitives import NodeType
from geoskill.graphs.motif_graph import MotifGraph


def noisy(descriptors: Float[Tensor, "n d"], strength: float, generator: torch.Generator) -> Float[Tensor, "n d"]:
    """Unit-norm descriptors with Gaussian noise whose expected squared norm is ``strength`` squared.

    The SD of one component is ``strength / sqrt(d)``, so one value means the same for descriptors of any length.
    """
    noise = torch.randn(descriptors.shape, generator=generator, device=descriptors.device, dtype=descriptors.dtype)
    return descriptors + noise * (strength / math.sqrt(descriptors.shape[1]))


def sample_visible(
    graph: MotifGraph, types: Sequence[NodeType], share: float, most: int | None, generator: torch.Generator
) -> dict[NodeType, Bool[Tensor, " n"]]:
    """Which features of a graph or batch take part in a step; others are hidden, as if they were occluded.

    The skill must then know which association is right when the best one cannot be seen. And a step takes no longer
    with more features: of many it looks at a few, others each time.

    Args:
        graph: one frame or a batch of frames.
        types: of features.
        share: the probability with which a feature is hidden.
        most: features of each type that are expected to be visible in a frame, at most; None for as many as there are.
        generator: draws them.
    """
    visible = {}
    for kind in types:
        counts = graph[f"{kind}_count"]
        hidden = torch.full_like(counts, share, dtype=torch.float32)
        if most is not None:
            hidden = torch.maximum(hidden, 1 - most / counts.clamp_min(1))
        drawn = torch.rand(int(counts.sum()), generator=generator, device=generator.device)
        visible[kind] = drawn >= hidden.repeat_interleave(counts)
    return visible
