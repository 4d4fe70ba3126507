"""What a member in space remembers of the end of its demonstration, in meters of the camera's frame at that time."""

from collections.abc import Sequence
from typing import Final

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from geoskill.geometry.primitives import NodeType
from geoskill.graphs.motif_graph import MotifGraph
from geoskill.model.kernel_model import KernelModel
from geoskill.training.selected_frames import SelectedFrame

MAX_STORED: Final = 256
MAX_SURROUNDINGS: Final = 1024
REST_M: Final = 0.015
"""What ends within this of where it is, and was no farther away before, rests; noise of depth is some millimeters."""
SAME_M: Final = 0.002
"""Two detections of a point nearer than this are one where their descriptors are similar, too."""


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
    resting = int((~moving).nonzero()[0])
    target = nodes[resting][1][rows, :3].median(dim=0).values
    nothing = {
        kind: (torch.zeros(0, nodes[node][0].shape[1]), torch.zeros(0, kind.space_dim))
        for node, kind in enumerate(member.kernel.roles)
    }
    around = dict(nothing)
    if NodeType.POINT in member.node_types:
        around[NodeType.POINT] = _resting_points(frames, target, similar[NodeType.POINT])
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


def _resting_points(
    frames: Sequence[SelectedFrame], target: Float[Tensor, "3"], similar: float
) -> tuple[Float[Tensor, "t d"], Float[Tensor, "t 3"]]:
    """Return descriptors and places of the points that rest, one for each look at a place, the nearest first."""
    descriptors, places = [], []
    for graph in (frame.graph for frame in reversed(frames)):
        chosen = _rests(graph)
        descriptors.append(graph[f"{NodeType.POINT}_descriptor"][chosen])
        places.append(graph[f"{NodeType.POINT}_space"][chosen])
    all_descriptors, all_places = torch.cat(descriptors), torch.cat(places)
    kept = list[int]()
    for row in (all_places - target).norm(dim=1).argsort(stable=True).tolist():
        near = (all_places[kept] - all_places[row]).norm(dim=1) < SAME_M
        alike = (all_descriptors[kept] - all_descriptors[row]).norm(dim=1) < similar / 2
        if not (near & alike).any():
            kept.append(row)
        if len(kept) == MAX_SURROUNDINGS:
            break
    return all_descriptors[kept], all_places[kept]


def _rests(graph: MotifGraph) -> Bool[Tensor, " n"]:
    kind = NodeType.POINT
    space, anchors = graph[f"{kind}_space"], graph[f"{kind}_anchor_space"]
    first = graph[f"{kind}_first_known_anchor"].clamp_max(anchors.shape[1] - 1)
    came = (anchors[torch.arange(len(space)), first] - space).norm(dim=1)
    goes = (graph[f"{kind}_final_space"] - space).norm(dim=1)
    rests: Tensor = (came <= REST_M) & (goes <= REST_M)  # not where one of them is NaN
    return rests
