"""How the control errors of a demonstration's instances change, and the scale of the reward that follows."""

import torch
from jaxtyping import Float, Shaped
from torch import Tensor

from geoskill.config import ObjectiveConfig
from geoskill.data.transitions import Transitions
from geoskill.errors import InputError
from geoskill.geometry.control_errors import error_norm
from geoskill.graphs.motif_graph import MotifGraph
from geoskill.model.kernel_model import KernelModel
from geoskill.objective.goal import goal_progress
from geoskill.objective.reward import beta_from_changes, error_change


def error_changes(member: KernelModel, graph: MotifGraph, kind: str) -> Float[Tensor, " m"]:
    """By how much each instance's error norm changes from the graph's frame to the one its features were followed to.

    0 where a node was not followed: such an instance earns no reward and costs none.
    """
    before = error_norm(member.control_errors(graph))
    after = error_norm(member.control_errors(graph, "next_geometry"))
    change = error_change(before, after, kind, member.kernel.resolution)
    known = _of_nodes(member, graph, "tracked").all(dim=0)
    return torch.where(known, change, torch.zeros_like(change))


def instance_goal_progress(member: KernelModel, graph: MotifGraph) -> Float[Tensor, " m"]:
    """What each instance earns for having come together by the end of the demonstration (:func:`goal_progress`).

    Its error before is the larger of that in the frame and that at the first anchor since which all of its nodes are
    known.
    """
    now = error_norm(member.control_errors(graph))
    places = member.attribute(graph, "anchor_xy")
    anchor = _of_nodes(member, graph, "first_known_anchor").amax(dim=0)
    anchors = places[member.node_types[0]].shape[1]
    rows = zip(member.kernel.roles, graph.instance_index, strict=True)
    nodes = [places[role][row, anchor.clamp_max(anchors - 1)] for role, row in rows]
    first = error_norm(member.kernel.control_error(nodes))
    before = torch.where(anchor < anchors, torch.maximum(now, first), now)
    after = error_norm(member.control_errors(graph, "final_xy"))
    known = _of_nodes(member, graph, "final_known").all(dim=0)
    return goal_progress(before, after, known, member.kernel.resolution)


def _of_nodes(member: KernelModel, graph: MotifGraph, name: str) -> Shaped[Tensor, "k m"]:
    """One value per feature, such as whether it was followed, of each node of every instance."""
    values = member.attribute(graph, name)
    return torch.stack([values[role][row] for role, row in zip(member.kernel.roles, graph.instance_index, strict=True)])


def fit_reward_scale(members: dict[str, KernelModel], demonstration: Transitions, objective: ObjectiveConfig) -> None:
    """Fit each member's beta to the demonstration, one for every span of time (METHOD #12).

    Raises:
        InputError: when no instance of a member moves over any span.
    """
    spans = torch.tensor(demonstration.spans)
    for name, member in members.items():
        changes: list[list[Tensor]] = [[] for _ in spans]
        moves: list[list[Tensor]] = [[] for _ in spans]
        for index in range(len(demonstration)):
            graph = demonstration.graph_without_negatives(name, index)
            span = int(graph.span_index)
            changes[span].append(error_changes(member, graph, objective.change))
            moves[span].append(error_changes(member, graph, "absolute").abs() > member.kernel.resolution)
        beta = torch.stack(
            [
                beta_from_changes(torch.cat(change), torch.cat(move), objective.beta_scale)
                for change, move in zip(changes, moves, strict=True)
            ]
        )
        if not beta.any():
            raise InputError(
                f"nothing moves in the demonstration: no {name} association that could be followed changes by more than"
                f" {member.kernel.resolution:g}; expected a video of a task being done"
            )
        member.set_reward_scale(spans, beta)
