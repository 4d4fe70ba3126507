"""When a member's associations settle in the demonstration, fitted when training ends (docs/experiments/phases.md).

::

    e(t)      = median over the selected associations of norm(E(t) - E(end)), each followed to the end by itself
    threshold = max(3 resolution, 1.5 times the median of e over the last tenth)
    share     = first frame from which on e stays below the threshold, over all frames

An association that ends beside its target, since what lies exactly there is covered in the end, settles when the others
do: what counts is what is left until its own end, as in the goal error.
"""

from collections.abc import Sequence
from typing import Final

import torch
from jaxtyping import Float
from torch import Tensor

from geoskill.control.settling import Settling
from geoskill.geometry.control_errors import error_norm
from geoskill.graphs.motif_graph import MotifGraph
from geoskill.model.kernel_model import KernelModel
from geoskill.training.error_changes import instance_goal_progress
from geoskill.training.evidence import MUCH_PROGRESS
from geoskill.training.selected_frames import TOP_K

RESOLUTION_FACTOR: Final = 3.0
"""The threshold is at least so many resolutions of the error."""
SPREAD_FACTOR: Final = 1.5
"""The threshold is at least so many medians of what is left in the last tenth."""
WINDOW: Final = 2
"""Frames on either side over which the median is taken, lest a single selection unsettles what has settled."""


@torch.no_grad()
def fit_settling(member: KernelModel, graphs: Sequence[MotifGraph]) -> None:
    """Fit a member's :class:`Settling`; a member whose selected associations never come together stays without.

    Args:
        member: with its final weights, in evaluation mode.
        graphs: of the demonstration's frames in the order of time, with instances and trajectories; all but those at
            the end that no shortest transition begins with.
    """
    frames, left, errors = list[int](), list[Tensor](), list[Tensor]()
    for frame, graph in enumerate(graphs):
        if graph.instance_index.shape[1] == 0:
            continue
        best = member(graph).topk(min(TOP_K, graph.instance_index.shape[1])).indices
        best = best[instance_goal_progress(member, graph)[best] >= MUCH_PROGRESS]
        if len(best):
            now, end = (member.control_errors(graph, name)[best] for name in ("geometry", "final_xy"))
            frames.append(frame)
            left.append(error_norm(now - end).median())
            errors.append(error_norm(now).median())
    if not frames:
        return
    gap = int(member.spans[0]) if len(member.spans) else 0
    smooth = _running_median(torch.stack(left))
    last = max(1, len(frames) // 10)
    tail = float(smooth[-last:].median())
    threshold = max(RESOLUTION_FACTOR * member.kernel.resolution, SPREAD_FACTOR * tail)
    above = (smooth >= threshold).nonzero().squeeze(1)
    settled = frames[int(above[-1])] + 1 if len(above) else 0
    error_at_end = float(torch.stack(errors[-last:]).median())
    member.set_settling(Settling(settled / (len(graphs) + gap), threshold, error_at_end))


def _running_median(values: Float[Tensor, " n"]) -> Float[Tensor, " n"]:
    """Return the median of each value with its neighbors, of which the first and the last have fewer."""
    windows = [values[max(0, row - WINDOW) : row + WINDOW + 1].median() for row in range(len(values))]
    return torch.stack(windows)
