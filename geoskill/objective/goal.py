"""The goal: what a demonstration brings together, and keeps together until its end, is what it is about.

The incremental reward looks at the way and cannot tell the point that meets its partner from its neighbor, which meets
it all but a centimeter. The end can. A term that only wants small errors in the end would choose what never was apart
(METHOD, "The reward is the weak spot, and how to mend it"); this one is conditional on having approached.

    goal_progress  a_i = log((before_i + s) / (after_i + s)) / (1 + log((before_i + s) / s))
    goal         = mean over frames of KL(q || g),   q = softmax(a / T),   g = softmax(b / (scale T))

q is the distribution of maximum entropy for its mean goal_progress. The select-out at the goal's temperature is drawn to it
rather than made to maximize the mean of a itself: that one is linear in g and, measured, collapses on whichever
instance leads first.

It wants scores b of ``scale`` times the goal_progress. A low temperature T looks at the best instances and tells them apart;
a high one also ranks those that are left when the best are hidden. That scores learn more than which instance is the
best, while the select-out itself stays decided, is as in "Distilling the Knowledge in a Neural Network" (Hinton et al.,
2015).
"""

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor
from torch_geometric.utils import scatter

from geoskill.objective.selection import select_out

# Error within which two places are the same, in units of what detection resolves: the detections of two features, each
# followed or found twice.
SAME_PLACE = 4.0


def goal_progress(
    before: Float[Tensor, " m"], after: Float[Tensor, " m"], known: Bool[Tensor, " m"], resolution: float
) -> Float[Tensor, " m"]:
    """How much of the digits of its error each instance lost until the end: below 1, and 0 for what stays as it is.

    Args:
        before: the largest norm of its control error that is known, of the frame's past and of the frame itself.
        after: the norm at the end of the demonstration.
        known: whether ``after`` is; other instances earn 0.
        resolution: error within what detection resolves, in the error's unit.

    From 96 px to nothing, to 8 px, and apart:

    >>> before, after = torch.tensor([96.0, 96.0, 2.0]), torch.tensor([0.0, 8.0, 12.0])
    >>> goal_progress(before, after, torch.ones(3, dtype=torch.bool), resolution=1.0)
    tensor([ 0.7630,  0.5026, -0.6979])
    """
    same = SAME_PLACE * resolution
    approached = torch.log((before + same) / (after + same)) / (1.0 + torch.log((before + same) / same))
    return torch.where(known, approached, torch.zeros_like(approached))


def goal_divergence(
    scores: Float[Tensor, " m"],
    goal_progress: Float[Tensor, " m"],
    temperature: float,
    scale: float,
    batch: Int[Tensor, " m"],
    num_frames: int,
) -> Float[Tensor, " frames"]:
    """KL(q || g) of each frame; 0 without instances.

    Args:
        scores: b.
        goal_progress: of :func:`goal_progress`.
        temperature: how much less than the best goal_progress still counts a third as much.
        scale: what an instance's score should be ahead of another's, over what its goal_progress is.
        batch: the frame of each instance, sorted.
        num_frames: frames, those without any instance included.

    Two instances of equal score, of which one should count three times as much; and a frame without any:

    >>> b, a = torch.tensor([0.0, 0.0]), torch.tensor([0.0, 0.05 * torch.log(torch.tensor(3.0))])
    >>> goal_divergence(b, a, 0.05, 200.0, torch.tensor([0, 0]), num_frames=2)
    tensor([0.1308, 0.0000])
    """
    tiny = torch.finfo(scores.dtype).tiny
    wanted = select_out(goal_progress / temperature, batch, num_frames)
    selected = select_out(scores / (scale * temperature), batch, num_frames)
    terms = wanted * (wanted.clamp_min(tiny).log() - selected.clamp_min(tiny).log())
    divergence: Tensor = scatter(terms, batch, dim=0, dim_size=num_frames, reduce="sum")
    return divergence
