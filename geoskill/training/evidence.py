"""Evidence that something was learned, gathered from the demonstration when training ends."""

from collections.abc import Iterable

import torch

from geoskill.graphs.motif_graph import MotifGraph
from geoskill.model.evidence import Evidence
from geoskill.model.kernel_model import KernelModel
from geoskill.training.error_changes import errors_at_ends, instance_goal_progress

# Goal progress of an association that has come together, such as from 96 px to 39, and of one that has come closer at
# all, from 96 px to 77.
MUCH_PROGRESS = 0.2
SOME_PROGRESS = 0.05


@torch.no_grad()
def fit_evidence(member: KernelModel, graphs: Iterable[MotifGraph]) -> None:
    """Gather a member's :class:`Evidence` from the frames of a demonstration.

    Args:
        member: with its final weights, in evaluation mode.
        graphs: of the frames, with instances and trajectories.
    """
    approached, ratios, approaching = [], [], []
    for graph in graphs:
        if graph.instance_index.shape[1] == 0:
            continue
        best = int(member(graph).argmax())
        progress = instance_goal_progress(member, graph)
        before, after = errors_at_ends(member, graph)
        approached.append(float(progress[best]) >= MUCH_PROGRESS)
        approaching.append(float((progress >= SOME_PROGRESS).sum()))
        if approached[-1]:
            ratios.append(float(after[best] / before[best]))
    if approached:
        member.set_evidence(
            Evidence(
                sum(approached) / len(approached),
                float(torch.tensor(ratios).median()) if ratios else 1.0,
                float(torch.tensor(approaching).median()),
            )
        )
