"""Changes of the control errors of a demonstration's instances, and the scale of the reward fitted to them."""

import torch
from jaxtyping import Float, Shaped
from torch import Tensor

from geoskill.config import ObjectiveConfig
from geoskill.data.transitions import Transitions
from geoskill.errors import InputError
from geoskill.geometry.control_errors import error_norm
from geoskill.graphs.motif_graph import MotifGraph
from geoskill.model.kernel_model import KernelModel
from geoskill.objective.goal import UNRELATED_PROGRESS, goal_progress
from geoskill.objective.reward import beta_from_changes, error_change
from geoskill.tracking.motion import Part


def error_changes(member: KernelModel, graph: MotifGraph, change: str) -> Float[Tensor, " m"]:
    """Return by how much each instance's error norm changes between the graph's frame and the transition's other frame.

    0 when a node could not be tracked, or its depth there is not known: it earns no reward and costs none.

    Args:
        member: gives the control error and its resolution.
        graph: one frame or a batch of frames, with instances and displacements.
        change: the measure of :func:`~geoskill.objective.reward.error_change`.
    """
    before = error_norm(member.control_errors(graph))
    after = error_norm(member.control_errors(graph, "next_geometry"))
    changes = error_change(before, after, change, member.kernel.resolution)
    known = _node_values(member, graph, "tracked").all(dim=0) & after.isfinite()
    return torch.where(known, changes, torch.zeros_like(changes))


def instance_goal_progress(member: KernelModel, graph: MotifGraph) -> Float[Tensor, " m"]:
    """Return the progress of each instance toward the end of the demonstration (:func:`goal_progress`).

    An instance that cannot define the task, because it has an
    unrelated node, or because all of its nodes are on the carried thing or all on the background, has
    :data:`~geoskill.objective.goal.UNRELATED_PROGRESS`.
    """
    before, after = errors_at_ends(member, graph)
    known = _node_values(member, graph, "final_known").all(dim=0) & after.isfinite()
    progress = goal_progress(before, after, known, member.kernel.resolution)
    part = _node_values(member, graph, "part")
    same = (part == part[0]).all(dim=0) & ((part[0] == Part.THING) | (part[0] == Part.BACKGROUND))
    hopeless = same | (part == Part.UNRELATED).any(dim=0)
    return torch.where(hopeless, torch.full_like(progress, UNRELATED_PROGRESS), progress)


def errors_at_ends(member: KernelModel, graph: MotifGraph) -> tuple[Float[Tensor, " m"], Float[Tensor, " m"]]:
    """Return the norm of each instance's control error before, and at the end of the demonstration.

    The one before is the larger of that in the frame and that at the first anchor since which all of its nodes are
    known; the one in the frame when there is no such anchor. Where the end is not known, it is as in the frame; where
    only its depth is not known, it is NaN.
    """
    now = error_norm(member.control_errors(graph))
    places = member.places(graph, "anchor_xy")
    anchor = _node_values(member, graph, "first_known_anchor").amax(dim=0)
    anchors = places[member.node_types[0]].shape[1]
    rows = zip(member.kernel.roles, graph.instance_index, strict=True)
    nodes = [places[role][row, anchor.clamp_max(anchors - 1)] for role, row in rows]
    at_anchor = error_norm(member.kernel.control_error(nodes))
    before = torch.where((anchor < anchors) & at_anchor.isfinite(), torch.maximum(now, at_anchor), now)
    return before, error_norm(member.control_errors(graph, "final_xy"))


def _node_values(member: KernelModel, graph: MotifGraph, name: str) -> Shaped[Tensor, "k m"]:
    """Return one value per node of every instance from a per-feature attribute such as ``tracked``."""
    values = member.attribute(graph, name)
    return torch.stack([values[role][row] for role, row in zip(member.kernel.roles, graph.instance_index, strict=True)])


def fit_reward_scale(members: dict[str, KernelModel], demonstration: Transitions, objective: ObjectiveConfig) -> None:
    """Fit each member's beta to the demonstration, one for every span of time (design choice 12).

    Raises:
        InputError: when no instance of a member moves over any span.
    """
    spans = torch.tensor(demonstration.spans)
    for name, member in members.items():
        changes: list[list[Tensor]] = [[] for _ in spans]
        moving: list[list[Tensor]] = [[] for _ in spans]
        for index in range(len(demonstration)):
            graph = demonstration.graph_without_negatives(name, index)
            span = int(graph.span_index)
            changes[span].append(error_changes(member, graph, objective.change))
            moving[span].append(error_changes(member, graph, "absolute").abs() > member.kernel.resolution)
        beta = torch.stack(
            [
                beta_from_changes(torch.cat(span_changes), torch.cat(span_moving), objective.beta_scale)
                for span_changes, span_moving in zip(changes, moving, strict=True)
            ]
        )
        if not beta.any():
            raise InputError(
                f"nothing moves in the demonstration: no {name} association that could be tracked changes by more than"
                f" {member.kernel.resolution:g}; expected a video of a task being done"
            )
        member.set_reward_scale(spans, beta)
