"""What a member in space remembers of the end of its demonstration, in meters of the camera's frame at that time."""

from collections.abc import Sequence
from typing import Final

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from geoskill.geometry.primitives import NodeType
from geoskill.geometry.space import point_to_line_in_space
from geoskill.graphs.motif_graph import MotifGraph
from geoskill.model.kernel_model import KernelModel
from geoskill.training.selected_frames import SelectedFrame

MAX_STORED: Final = 256
MAX_SURROUNDINGS: Final = 1024
REST_M: Final = 0.015
"""What ends within this of where it is, and was no farther away before, rests; noise of depth is some millimeters."""
SAME_M: Final = 0.002
"""Two detections nearer than this are one where their descriptors are similar, too."""


def fit_goal_in_space(
    member: KernelModel, moving: Bool[Tensor, " k"], frames: Sequence[SelectedFrame], similar: dict[NodeType, float]
) -> bool:
    """Fit a member's ``goal`` in space, but for its tolerance, and return whether there was anything to fit.

    The camera is taken to rest during the demonstration.

    Args:
        member: with its final weights.
        moving: which nodes move.
        frames: with what the member selects.
        similar: by how much two descriptors of one feature may differ.
    """
    nodes = [_stored_node(kind, node, frames, bool(moving[node])) for node, kind in enumerate(member.kernel.roles)]
    known = torch.stack([ends.isfinite().all(dim=1) for _, ends in nodes]).all(dim=0)
    rows = known.nonzero().squeeze(1)
    rows = rows[torch.linspace(0, len(rows) - 1, min(MAX_STORED, len(rows))).round().long()]
    if len(rows) == 0:
        return False
    target = _near_target(member, moving, [ends[rows] for _, ends in nodes])
    nothing = {
        kind: (torch.zeros(0, nodes[node][0].shape[1]), torch.zeros(0, kind.space_dim))
        for node, kind in enumerate(member.kernel.roles)
    }
    around = dict(nothing)
    for kind in member.node_types:
        if kind in (NodeType.POINT, NodeType.LINE):
            around[kind] = _resting_features(kind, frames, target, similar[kind])
    member.goal.fit(moving, [(descriptors[rows], ends[rows]) for descriptors, ends in nodes], around, nothing, similar)
    return True


def _stored_node(
    kind: NodeType, node: int, frames: Sequence[SelectedFrame], moves: bool
) -> tuple[Float[Tensor, "r d"], Float[Tensor, "r s"]]:
    """Return descriptors and places at the end of one node of all selected instances; NaN where not known."""
    descriptors, ends = [], []
    for frame in frames:
        rows = frame.index[node]
        descriptors.append(frame.graph[f"{kind}_descriptor"][rows])
        if moves:
            known = frame.graph[f"{kind}_final_known"][rows]
            places = frame.graph[f"{kind}_final_space"][rows]
            ends.append(torch.where(known[:, None], places, torch.full_like(places, torch.nan)))
        else:
            ends.append(frame.graph[f"{kind}_space"][rows])
    return torch.cat(descriptors), torch.cat(ends)


def _near_target(
    member: KernelModel, moving: Bool[Tensor, " k"], ends: Sequence[Float[Tensor, "r s"]]
) -> Float[Tensor, "3"]:
    """Return a place on the target: of the resting nodes, or of what came there where these are planes, without one."""
    roles = member.kernel.roles
    order = sorted(range(len(roles)), key=lambda node: (roles[node] is NodeType.PLANE, bool(moving[node])))
    place: Tensor = _middle(ends[order[0]]).median(dim=0).values
    return place


def _resting_features(
    kind: NodeType, frames: Sequence[SelectedFrame], target: Float[Tensor, "3"], similar: float
) -> tuple[Float[Tensor, "t d"], Float[Tensor, "t s"]]:
    """Return descriptors and places of the points or lines that rest, one for each look at a place, nearest first."""
    descriptors, places = [], []
    for graph in (frame.graph for frame in reversed(frames)):
        chosen = _rests(kind, graph)
        descriptors.append(graph[f"{kind}_descriptor"][chosen])
        places.append(graph[f"{kind}_space"][chosen])
    all_descriptors, all_places = torch.cat(descriptors), torch.cat(places)
    kept = list[int]()
    for row in (_middle(all_places) - target).norm(dim=1).argsort(stable=True).tolist():
        near = _apart(all_places[[row]].expand(len(kept), -1), all_places[kept]) < SAME_M
        alike = (all_descriptors[kept] - all_descriptors[row]).norm(dim=1) < similar / 2
        if not (near & alike).any():
            kept.append(row)
        if len(kept) == MAX_SURROUNDINGS:
            break
    return all_descriptors[kept], all_places[kept]


def _rests(kind: NodeType, graph: MotifGraph) -> Bool[Tensor, " n"]:
    space, anchors = graph[f"{kind}_space"], graph[f"{kind}_anchor_space"]
    first = graph[f"{kind}_first_known_anchor"].clamp_max(anchors.shape[1] - 1)
    came = _apart(anchors[torch.arange(len(space)), first], space)
    goes = _apart(graph[f"{kind}_final_space"], space)
    rests: Tensor = (came <= REST_M) & (goes <= REST_M)  # not where one of them is NaN
    return rests


def _apart(first: Float[Tensor, "n s"], second: Float[Tensor, "n s"]) -> Float[Tensor, " n"]:
    """Return the distances of points, or of the ends of lines from the carriers of others, in meters."""
    if first.shape[1] == NodeType.POINT.space_dim:
        apart: Tensor = (first - second).norm(dim=1)
    else:
        ends = [point_to_line_in_space(end, second).norm(dim=1) for end in (first[:, :3], first[:, 3:])]
        apart = torch.maximum(*ends)
    return apart


def _middle(places: Float[Tensor, "n s"]) -> Float[Tensor, "n 3"]:
    """Return points themselves, and the midpoints of lines."""
    middle: Tensor = places.reshape(len(places), -1, 3).mean(dim=1)
    return middle
