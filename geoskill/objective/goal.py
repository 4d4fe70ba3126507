"""The goal term: a demonstration is about what it brings together and keeps together until its end.

The incremental reward compares frames along the way and cannot tell the point that meets its partner from a neighbor
that comes within a centimeter. The end of the demonstration can. A term that only wants small errors at the end would
select instances that never were apart (docs/method.md, Reward); this one requires that an instance has approached.

    goal_progress  a_i = log((before_i + s) / (after_i + s)) / (1 + log((before_i + s) / s))
    goal         = mean over frames of w KL(q || g),   q = softmax(a / T),   g = softmax(b / (scale T))
    w            = min(1, sum of q max(a, 0) / 0.3) where the places of the carried thing are known, 1 elsewhere

q is the distribution of maximum entropy for its mean progress. The select-out at the goal's temperature is drawn to q
rather than made to maximize the mean of a: that objective is linear in g and collapses on whichever instance leads
first (docs/experiments/goal.md).

Where the places of the carried thing are known (:mod:`geoskill.tracking.places`), a frame in which nothing is known to
have approached says nothing: its q is nearly uniform, and w nearly 0. With w = 1 it would hold down the scores of what
other frames show to be right. Elsewhere all frames count, since tracking tells little of any of them, and the same w
costs accuracy (docs/experiments/places.md).

The optimal scores b are ``scale`` times the progress. A low temperature T separates the best instances; a high one also
ranks those that remain when the best are hidden. Scores thus learn more than which instance is the best, while the
select-out itself stays decided, as in "Distilling the Knowledge in a Neural Network" (Hinton et al., 2015).
"""

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor
from torch_geometric.utils import scatter

from geoskill.objective.selection import select_out

# Distance within which two features are at the same place, over the resolution: both are detected, and each of them is
# tracked or detected a second time.
SAME_PLACE = 4.0
# Progress of an instance that cannot define the task: as little as one that loses all that another can gain.
UNRELATED_PROGRESS = -1.0
# Expected progress from which on a frame counts in full: that from 96 px to 27.
INFORMATIVE_PROGRESS = 0.3


def goal_progress(
    before: Float[Tensor, " m"], after: Float[Tensor, " m"], known: Bool[Tensor, " m"], resolution: float
) -> Float[Tensor, " m"]:
    """Return how much of the logarithm of its error each instance lost until the end: below 1, and 0 for no change.

    Args:
        before: the largest known norm of its control error, in the frame's past and in the frame itself.
        after: the norm at the end of the demonstration.
        known: whether ``after`` is known; other instances have progress 0.
        resolution: error within what detection resolves, in the error's unit.

    From 96 px to 0, from 96 px to 8 px, and from 2 px to 12 px:

    >>> before, after = torch.tensor([96.0, 96.0, 2.0]), torch.tensor([0.0, 8.0, 12.0])
    >>> goal_progress(before, after, torch.ones(3, dtype=torch.bool), resolution=1.0)
    tensor([ 0.7630,  0.5026, -0.6979])
    """
    same = SAME_PLACE * resolution
    progress = torch.log((before + same) / (after + same)) / (1.0 + torch.log((before + same) / same))
    return torch.where(known, progress, torch.zeros_like(progress))


def goal_divergence(
    scores: Float[Tensor, " m"],
    goal_progress: Float[Tensor, " m"],
    temperature: float,
    scale: float,
    batch: Int[Tensor, " m"],
    num_frames: int,
    by_progress: Bool[Tensor, " frames"] | None = None,
) -> Float[Tensor, " frames"]:
    """Return w KL(q || g) of each frame in nats; 0 for a frame without instances.

    Args:
        scores: b.
        goal_progress: of :func:`goal_progress`.
        temperature: T, the difference in progress that divides the wanted weight by e.
        scale: the wanted difference of two scores, over the difference of their progress.
        batch: the frame of each instance, sorted.
        num_frames: number of frames, those without any instance included.
        by_progress: for which frames w is as above, and not 1; None for none.

    Two instances of equal score, one of which should count three times as much; and a frame without instances:

    >>> b, a = torch.tensor([0.0, 0.0]), 0.5 + torch.tensor([0.0, 0.05 * torch.log(torch.tensor(3.0))])
    >>> goal_divergence(b, a, 0.05, 200.0, torch.tensor([0, 0]), num_frames=2)
    tensor([0.1308, 0.0000])
    """
    tiny = torch.finfo(scores.dtype).tiny
    wanted = select_out(goal_progress / temperature, batch, num_frames)
    selected = select_out(scores / (scale * temperature), batch, num_frames)
    terms = wanted * (wanted.clamp_min(tiny).log() - selected.clamp_min(tiny).log())
    divergence: Tensor = scatter(terms, batch, dim=0, dim_size=num_frames, reduce="sum")
    if by_progress is None:
        return divergence
    progress: Tensor = scatter(wanted * goal_progress.clamp_min(0), batch, dim=0, dim_size=num_frames, reduce="sum")
    weight = (progress / INFORMATIVE_PROGRESS).clamp_max(1.0)
    return torch.where(by_progress, weight * divergence, divergence)
