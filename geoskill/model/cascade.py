"""Of many instances, only those that a factorized score likes best are worth the costly one.

A score is a part that is cheap for all pairs, and a costly one, here that of message passing. Of the costly part a
frame's own additive model is made, the mean over a few partners spread over the frame::

    costly(i, j) ~ a_i + a_j + constant,    a_i = mean_r costly(i, r)

which takes a few instances for each feature. By the sum of both the K best are chosen, and only these are looked at:
a coarse stage passes on to a fine one ("Rapid object detection using a boosted cascade of simple features", Viola and
Jones, CVPR 2001). The cheap part alone will not do. Message passing likes unknown features where likeness to the
demonstration does not, and the best by the sum is often not among the best by one.
"""

from collections.abc import Mapping

import torch
from jaxtyping import Float, Int64
from torch import Tensor

from geoskill.geometry.primitives import NodeType
from geoskill.model.chunks import Score
from geoskill.model.scorer import Motif

# Partners of each feature. On 131 frames of real videos with 512 features each, the best of 131,000 instances is among
# the 450 best by the estimate; with one partner among 26,000.
PARTNERS = 4


def cascade(
    cheap: Float[Tensor, " m"],
    costly: Score,
    motif: Motif,
    counts: Mapping[NodeType, int],
    instance_index: Int64[Tensor, "k m"],
    budget: int,
) -> Float[Tensor, " m"]:
    """The sum of the cheap and the costly part of the K instances that are estimated to be best; of others an estimate.

    The estimate is corrected by its mean error on the K. No other instance can then be ahead of all that were looked
    at: the best of them is no worse than their mean, which is that of their estimates, and no other's estimate is
    larger than any of theirs. Of equal estimates, which are looked at is arbitrary.

    Args:
        cheap: the cheap part.
        costly: the other part, of some instances.
        motif: what an instance looks like.
        counts: features of each type.
        instance_index: of all instances; more than K.
        budget: K, at least 1.
    """
    effects = main_effects(costly, motif, counts, instance_index.device)
    estimate = cheap + torch.stack([effect[row] for effect, row in zip(effects, instance_index, strict=True)]).sum(
        dim=0
    )
    best = torch.topk(estimate, budget).indices
    exact = cheap[best] + costly(instance_index[:, best])
    return (estimate + (exact - estimate[best]).mean()).index_copy(0, best, exact)


def main_effects(
    score: Score, motif: Motif, counts: Mapping[NodeType, int], device: torch.device
) -> list[Float[Tensor, " n"]]:
    """For each role, the mean score of each feature in it with some partners, the same for all features.

    Partners are spread over the features in their order, which is by strength. One of them is with itself, too: so
    additive scores are found exactly.
    """
    effects: list[Tensor] = []
    for role, kind in enumerate(motif.roles):
        alike = min(order[role] for order in motif.automorphisms)
        if alike < role:  # the motif does not tell them apart
            effects.append(effects[alike])
            continue
        features = torch.arange(counts[kind], device=device).repeat_interleave(PARTNERS)
        index = torch.stack(
            [
                # Each role starts with another one, lest there be one partner in two roles.
                features if place == role else _spread(counts[other], device).roll(place).repeat(counts[kind])
                for place, other in enumerate(motif.roles)
            ]
        )
        effects.append(score(index).reshape(-1, PARTNERS).mean(dim=1))
    return effects


def _spread(count: int, device: torch.device) -> Int64[Tensor, " partners"]:
    return (2 * torch.arange(PARTNERS, device=device) + 1) * count // (2 * PARTNERS)
