"""A cascade: a factorized estimate picks the few instances that are worth an expensive score.

A score is the sum of a part that is cheap for all instances and an expensive part, here that of message passing. The
expensive part is estimated by an additive model of the frame, the mean over a few partners spread over the frame::

    expensive(i, j) ~ a_i + a_j + constant,    a_i = mean_r expensive(i, r)

which takes a few instances per feature. The K instances with the largest estimated sum are then scored exactly: a
coarse stage passes on to a fine one ("Rapid object detection using a boosted cascade of simple features", Viola and
Jones, CVPR 2001). The cheap part alone does not find them: message passing gives unknown features high scores where
similarity to the demonstration does not, so the best instance by the sum is often not among the best by one part.
"""

from collections.abc import Mapping

import torch
from jaxtyping import Float, Int64
from torch import Tensor

from geoskill.geometry.primitives import NodeType
from geoskill.model.chunks import Score
from geoskill.model.scorer import Motif

# Partners per feature, just enough for the best instance to be among the best estimates (docs/experiments/speed.md).
PARTNERS = 4


def cascade(
    cheap: Float[Tensor, " m"],
    expensive: Score,
    motif: Motif,
    counts: Mapping[NodeType, int],
    instance_index: Int64[Tensor, "k m"],
    budget: int,
) -> Float[Tensor, " m"]:
    """Return exact sums of both parts for the K instances with the best estimates, and estimates for all others.

    Estimates are corrected by their mean error on the K instances, so that the best score is always an exact one: the
    best of the K is no worse than their mean, which equals the mean of their corrected estimates, and no other estimate
    is larger than any of these. Ties between estimates are broken arbitrarily.

    Args:
        cheap: the cheap part of all instances.
        expensive: computes the expensive part of some instances.
        motif: the motif of the instances.
        counts: number of features of each type.
        instance_index: all instances; more than K.
        budget: K, at least 1.
    """
    effects = main_effects(expensive, motif, counts, instance_index.device)
    estimate = cheap + torch.stack([effect[row] for effect, row in zip(effects, instance_index, strict=True)]).sum(
        dim=0
    )
    best = torch.topk(estimate, budget).indices
    exact = cheap[best] + expensive(instance_index[:, best])
    return (estimate + (exact - estimate[best]).mean()).index_copy(0, best, exact)


def main_effects(
    score: Score, motif: Motif, counts: Mapping[NodeType, int], device: torch.device
) -> list[Float[Tensor, " n"]]:
    """Return, for each role, the mean score of each feature in that role with the same few partners for all features.

    Partners are spread over the features in their order, which is by strength. A feature may be its own partner;
    leaving that pair out would make the estimate of additive scores inexact.
    """
    effects: list[Tensor] = []
    for role, node_type in enumerate(motif.roles):
        first_equivalent = min(order[role] for order in motif.automorphisms)
        if first_equivalent < role:  # the motif does not tell the two roles apart
            effects.append(effects[first_equivalent])
            continue
        features = torch.arange(counts[node_type], device=device).repeat_interleave(PARTNERS)
        index = torch.stack(
            [
                # Rolled by the role, so that no feature is the partner in two roles at once.
                features
                if partner_role == role
                else _partners(counts[partner_type], device).roll(partner_role).repeat(counts[node_type])
                for partner_role, partner_type in enumerate(motif.roles)
            ]
        )
        effects.append(score(index).reshape(-1, PARTNERS).mean(dim=1))
    return effects


def _partners(count: int, device: torch.device) -> Int64[Tensor, " partners"]:
    """Return evenly spread indices of ``count`` features."""
    return (2 * torch.arange(PARTNERS, device=device) + 1) * count // (2 * PARTNERS)
