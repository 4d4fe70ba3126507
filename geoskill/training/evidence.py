"""Evidence that something was learned, gathered from the demonstration when training ends."""

from collections.abc import Mapping

import torch

from geoskill.data.transitions import Transitions
from geoskill.model.evidence import Evidence
from geoskill.model.kernel_model import KernelModel
from geoskill.training.error_changes import errors_at_ends, instance_goal_progress
from geoskill.training.selected_frames import first_demonstration

# Goal progress of an association that has come together, such as from 96 px to 39, and of one that has come closer at
# all, from 96 px to 77.
MUCH_PROGRESS = 0.2
SOME_PROGRESS = 0.05


@torch.no_grad()
def fit_evidence(members: Mapping[str, KernelModel], demonstration: Transitions) -> None:
    """Gather each member's :class:`Evidence` from the frames of the first demonstration.

    Args:
        members: by name, with their final weights, in evaluation mode.
        demonstration: the one they were trained on.
    """
    for name, member in members.items():
        approached, ratios, approaching = [], [], []
        for graph in first_demonstration(name, demonstration):
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
