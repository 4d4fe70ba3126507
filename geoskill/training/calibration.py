"""What is fitted to the demonstration when training ends: confidence, direction of segments, goal, evidence, order."""

from collections.abc import Mapping

import torch
from torch import Tensor

from geoskill.data.transitions import Transitions
from geoskill.model.confidence import score_margins
from geoskill.model.kernel_model import KernelModel
from geoskill.training.evidence import fit_evidence
from geoskill.training.goal_reference import fit_goal_reference
from geoskill.training.reference_axis import fit_reference_axis
from geoskill.training.selected_frames import first_demonstration
from geoskill.training.settling import fit_settling


def calibrate(members: Mapping[str, KernelModel], demonstration: Transitions) -> None:
    """Fit everything that depends on trained weights.

    Members are left in evaluation mode, in which they score as a skill does: in training mode a cascade scores all
    instances exactly.

    Args:
        members: by name, with the weights that they are to be used with.
        demonstration: the one they were trained on.
    """
    fit_reference_margin(members, demonstration)
    for name, member in members.items():
        graphs = first_demonstration(name, demonstration)
        fit_reference_axis(member, graphs)
        fit_goal_reference(name, member, graphs)
        fit_evidence(member, graphs)
        fit_settling(member, graphs)


def is_calibration(key: str) -> bool:
    """Return whether an entry of a member's state is fitted by :func:`calibrate`."""
    return (
        key.endswith((".reference_margin", ".level_values", ".reference_axis", ".evidence_values", ".settling_values"))
        or ".goal." in key
    )


def uncalibrated(members: Mapping[str, KernelModel], prefix: str) -> dict[str, Tensor]:
    """Return the entries of a checkpoint that :func:`calibrate` fits, as they are before.

    Args:
        members: by name.
        prefix: of the names of their state.
    """
    state: dict[str, Tensor] = {}
    for name, member in members.items():
        fresh = KernelModel(member.kernel, member.extractors, member.scorer).state_dict(prefix=f"{prefix}{name}.")
        state |= {key: value for key, value in fresh.items() if is_calibration(key)}
    return state


@torch.no_grad()
def fit_reference_margin(members: Mapping[str, KernelModel], demonstration: Transitions) -> None:
    """Fit each member's ``reference_margin`` and ``reference_level``.

    They are medians over the demonstration's frames: of the best score's margin, and of the mean score. Frames with
    fewer than two associations have no margin and are left out. Members are left in evaluation mode.

    Args:
        members: by name, with the weights that they are to be used with.
        demonstration: the one they were trained on.
    """
    for name, member in members.items():
        member.eval()
        scores = [member(graph) for graph in demonstration.frames(name) if graph.instance_index.shape[1] > 1]
        if scores:
            margins = torch.stack([score_margins(frame).max() for frame in scores])
            member.set_reference_margin(margins.median(), torch.stack([frame.mean() for frame in scores]).median())
