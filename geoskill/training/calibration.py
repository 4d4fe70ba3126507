"""The reference margin of a skill's confidence: by how much its choice leads in the demonstration."""

from collections.abc import Mapping

import torch

from geoskill.data.transitions import Transitions
from geoskill.model.confidence import score_margins
from geoskill.model.kernel_model import KernelModel


@torch.no_grad()
def fit_reference_margin(members: Mapping[str, KernelModel], demonstration: Transitions) -> None:
    """Fit each member's ``reference_margin``: the median over the demonstration's frames of the best score's margin.

    Frames with fewer than two associations have no margin and are left out. Members are left in evaluation mode, in
    which they score as a skill does: in training mode a cascade scores all instances exactly.

    Args:
        members: by name, with the weights that they are to be used with.
        demonstration: the one they were trained on.
    """
    for name, member in members.items():
        member.eval()
        scores = [member(graph) for graph in demonstration.frames(name) if graph.instance_index.shape[1] > 1]
        if scores:
            member.set_reference_margin(torch.stack([score_margins(frame).max() for frame in scores]).median())
