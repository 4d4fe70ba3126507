"""What a learned skill's confidence is measured by: how far ahead its choice is in the demonstration."""

import torch

from geoskill.data.transitions import Transitions
from geoskill.model.confidence import score_margins
from geoskill.model.kernel_model import KernelModel


@torch.no_grad()
def fit_reference_margin(members: dict[str, KernelModel], demonstration: Transitions) -> None:
    """Fit each member's ``reference_margin``: the median over the demonstration's frames of the best score's lead.

    Frames with fewer than two associations have none and are left out. The members are in evaluation mode afterward,
    for the scores are to be those that a skill uses: in training mode a cascade scores all instances exactly.

    Args:
        members: by name, with the weights that they are to be used with.
        demonstration: the one they were trained on.
    """
    for name, member in members.items():
        member.eval()
        scores = [member(graph) for graph in demonstration.frames(name) if graph.instance_index.shape[1] > 1]
        if scores:
            member.set_reference_margin(torch.stack([score_margins(each).max() for each in scores]).median())
