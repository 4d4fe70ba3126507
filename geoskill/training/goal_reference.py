"""What members remember of the end of their demonstration, fitted when training ends."""

from collections.abc import Sequence
from typing import Final

import cv2
import numpy as np
import torch
from jaxtyping import Bool, Float
from torch import Tensor

from geoskill.geometry.anchored_map import mapped
from geoskill.geometry.primitives import NodeType
from geoskill.graphs.motif_graph import MotifGraph
from geoskill.model.kernel_model import KernelModel
from geoskill.skill.goal import goals_of
from geoskill.skill.goal_in_space import goal_in_space
from geoskill.skill.matching import TOLERANCE_PX
from geoskill.skill.scored_frame import ScoredInstances
from geoskill.training.goal_in_space import fit_goal_in_space
from geoskill.training.selected_frames import SelectedFrame, selected_frames

MAX_STORED: Final = 256
"""Instances that are kept."""
MAX_SURROUNDINGS: Final = 1024
"""Features of each type around the target that are kept; they look otherwise when the moving thing is beside them."""
LAST_FRAMES: Final = 8
"""Frames at the end, a quarter of a second, from which features are followed to the very end without drift."""
MIN_MOTION_SHARE: Final = 0.5
"""A node moves when it goes on average at least so far as this share of what the other one goes."""
MAX_DRIFT_RATIO: Final = 0.02
"""Flow leads a feature to within this of where it ends, as a ratio of the picture's size."""
MAX_CAME_RATIO: Final = 0.05
"""What came from farther away is not part of the target, as a ratio of the picture's size; a camera moves less."""
MAX_DRAG_RATIO: Final = 0.05
"""So far flow takes along what rests when something comes to cover it, as a ratio of the picture's size."""
MIN_STAY_SHARE: Final = 0.7
"""The camera rests where so many stay, as a share of the largest number that moves alike."""
SIMILAR_SHARE: Final = 0.5
"""As `demonstration.trajectory.similarity_ratio`."""
NOISE_FACTOR: Final = 3.0
"""The tolerance is at least so many standard deviations of noise of detection."""
SPREAD_FACTOR: Final = 2.0
"""The tolerance is at least so many medians of the noise of the goal error in the last frames."""


def fit_goal_reference(name: str, member: KernelModel, graphs: Sequence[MotifGraph]) -> None:
    """Fit a member's ``goal`` to a demonstration.

    A member of which it is not known which nodes move, since nothing it selects was followed to the end, stays without.

    Args:
        name: of the member.
        member: with its final weights and direction of segments, in evaluation mode.
        graphs: of the demonstration's frames in the order of time, with instances and trajectories.
    """
    frames = list(selected_frames(member, graphs))
    if frames:
        _fit(name, member, frames, graphs[-LAST_FRAMES:])


def _fit(name: str, member: KernelModel, frames: Sequence[SelectedFrame], last: Sequence[MotifGraph]) -> None:
    moving = _moving_nodes(member, frames)
    if moving is None:
        return
    resting = int((~moving).nonzero()[0])
    similar = {kind: _similar(kind, last) for kind in member.node_types}
    if member.kernel.in_space:
        if fit_goal_in_space(member, moving, frames, similar):
            member.goal.set_tolerance(_tolerance(name, member, last))
        return
    nodes = [
        _stored_node(kind, node, frames, last, bool(moving[node]), similar[kind])
        for node, kind in enumerate(member.kernel.roles)
    ]
    known = torch.stack([rows_known for _, _, rows_known in nodes]).all(dim=0)
    rows = known.nonzero().squeeze(1)
    rows = rows[torch.linspace(0, len(rows) - 1, min(MAX_STORED, len(rows))).round().long()]
    if len(rows) == 0:
        return
    target = _middle(nodes[resting][1][rows]).median(dim=0).values

    def at_end(*, resting: bool) -> dict[NodeType, tuple[Tensor, Tensor]]:
        return {
            kind: _features_at_end(kind, frames, last, similar[kind], target, resting=resting)
            for kind in member.node_types
        }

    member.goal.fit(
        moving,
        [(descriptors[rows], ends[rows]) for descriptors, ends, _ in nodes],
        at_end(resting=True),
        at_end(resting=False),
        similar,
    )
    member.goal.set_tolerance(_tolerance(name, member, last))


def _moving_nodes(member: KernelModel, frames: Sequence[SelectedFrame]) -> Bool[Tensor, " k"] | None:
    """Return which nodes of the selected instances move, or None where that is not known."""
    total, motion = torch.zeros(()), torch.zeros(len(member.kernel.roles))
    for frame in frames:
        for index, weight in zip(frame.index.T, frame.weight, strict=True):
            ways = []
            for kind, row in zip(member.kernel.roles, index, strict=True):
                final, now = frame.graph[f"{kind}_final_xy"][row], frame.graph[f"{kind}_geometry"][row]
                known = bool(frame.graph[f"{kind}_final_known"][row])
                ways.append((_middle(final[None]) - _middle(now[None])).norm() if known else torch.tensor(torch.nan))
            own = torch.stack(ways)
            if own.isfinite().all():
                motion, total = motion + weight * own, total + weight
    if total == 0 or motion.max() / total < TOLERANCE_PX:
        return None
    moving = motion > MIN_MOTION_SHARE * motion.max()
    return None if moving.all() else moving


def _stored_node(
    kind: NodeType,
    node: int,
    frames: Sequence[SelectedFrame],
    last: Sequence[MotifGraph],
    moves: bool,
    similar: float,
) -> tuple[Float[Tensor, "r d"], Float[Tensor, "r g"], Bool[Tensor, " r"]]:
    """Return descriptors, geometry at the end, and whether that is known, of one node of all selected instances.

    Flow drifts over a demonstration: where a feature that looks the same was detected at the end near where flow led,
    that is where it is. What rests is where it was, since flow would take it along with what comes to cover it.
    """
    rows = [(frame.graph, row) for frame in frames for row in frame.index[node].tolist()]
    descriptors = torch.stack([graph[f"{kind}_descriptor"][row] for graph, row in rows])
    if not moves:
        ends = torch.cat([_at_end(kind, frame.graph)[frame.index[node]] for frame in frames])
        return descriptors, ends, torch.ones(len(ends), dtype=torch.bool)
    ends = torch.stack([graph[f"{kind}_final_xy"][row] for graph, row in rows])
    known = torch.stack([graph[f"{kind}_final_known"][row] for graph, row in rows])
    return descriptors, _snapped(kind, descriptors, ends, last, similar), known


def _snapped(
    kind: NodeType,
    descriptors: Float[Tensor, "r d"],
    ends: Float[Tensor, "r g"],
    last: Sequence[MotifGraph],
    similar: float,
) -> Float[Tensor, "r g"]:
    """Return where features end: where one that looks the same ends near where flow led, followed for a short time."""
    seen = [graph[f"{kind}_final_known"] for graph in last]
    detected = torch.cat([graph[f"{kind}_final_xy"][own] for graph, own in zip(last, seen, strict=True)])
    if len(detected) == 0 or len(ends) == 0:
        return ends
    difference = torch.cdist(
        descriptors, torch.cat([graph[f"{kind}_descriptor"][own] for graph, own in zip(last, seen, strict=True)])
    )
    distance = torch.cdist(_middle(ends), _middle(detected))
    near = max(2 * TOLERANCE_PX, MAX_DRIFT_RATIO * float(detected.max()))
    difference[(distance > near) | (difference > similar)] = torch.inf
    best, match = difference.min(dim=1)
    return torch.where(best.isfinite()[:, None], detected[match], ends)


def _at_end(kind: NodeType, graph: MotifGraph) -> Float[Tensor, "n g"]:
    """Return where a frame's features are in the picture of the end if they rest, though the camera may move.

    The picture has moved as most of the features that were followed to the end, and not at all where nearly as many
    stayed where they are.
    """
    geometry: Tensor = graph[f"{kind}_geometry"]
    known = graph[f"{kind}_final_known"]
    now, after = (_middle(own[known]).numpy().astype(np.float64) for own in (geometry, graph[f"{kind}_final_xy"]))
    if len(now) < 2:
        return geometry
    found, moved_along = cv2.estimateAffinePartial2D(now, after, method=cv2.RANSAC, ransacReprojThreshold=TOLERANCE_PX)
    stay = np.linalg.norm(after - now, axis=1) <= TOLERANCE_PX
    if found is None or stay.sum() >= MIN_STAY_SHARE * moved_along.sum():
        return geometry
    matrix = np.concatenate([found, [[0.0, 0.0, 1.0]]])
    return torch.from_numpy(mapped(matrix, geometry.numpy().astype(np.float64)).astype(np.float32))


def _features_at_end(
    kind: NodeType,
    frames: Sequence[SelectedFrame],
    last: Sequence[MotifGraph],
    similar: float,
    target: Float[Tensor, "2"],
    *,
    resting: bool,
) -> tuple[Float[Tensor, "t d"], Float[Tensor, "t g"]]:
    """Return descriptors and geometry at the end of what rests all the time, or of what does not.

    There is one entry for each look of a feature at a place, the nearest to the target first. The last frames alone
    would not do: there the moving thing covers what it came to.
    """
    descriptors, ends = [], []
    for graph in (frame.graph for frame in reversed(frames)):
        geometry, anchors = graph[f"{kind}_geometry"], graph[f"{kind}_anchor_xy"]
        first = graph[f"{kind}_first_known_anchor"].clamp_max(anchors.shape[1] - 1)
        before, at_rest = anchors[torch.arange(len(geometry)), first], _at_end(kind, graph)
        came = (_middle(before) - _middle(geometry)).norm(dim=1)
        goes = (_middle(graph[f"{kind}_final_xy"]) - _middle(at_rest)).norm(dim=1)
        size = float(geometry.max()) if len(geometry) else 0.0
        rests = (came <= MAX_CAME_RATIO * size) & (goes <= MAX_DRAG_RATIO * size)
        chosen = rests if resting else ~rests & graph[f"{kind}_final_known"]
        descriptors.append(graph[f"{kind}_descriptor"][chosen])
        ends.append((at_rest if resting else graph[f"{kind}_final_xy"])[chosen])
    all_descriptors, all_ends = torch.cat(descriptors), torch.cat(ends)
    if not resting:
        all_ends = _snapped(kind, all_descriptors, all_ends, last, similar)
    middles, kept = _middle(all_ends), list[int]()
    for row in (middles - target).norm(dim=1).argsort(stable=True).tolist():
        near = (middles[kept] - middles[row]).norm(dim=1) < TOLERANCE_PX / 2
        alike = (all_descriptors[kept] - all_descriptors[row]).norm(dim=1) < similar / 2
        if not (near & alike).any():
            kept.append(row)
        if len(kept) == MAX_SURROUNDINGS:
            break
    return all_descriptors[kept], all_ends[kept]


def _similar(kind: NodeType, last: Sequence[MotifGraph]) -> float:
    """Return by how much descriptors of one feature may differ: half of what those of different features mostly do."""
    differences = torch.cat([torch.pdist(graph[f"{kind}_descriptor"]) for graph in last])
    return SIMILAR_SHARE * float(differences.median()) if len(differences) else 0.0


def _tolerance(name: str, member: KernelModel, last: Sequence[MotifGraph]) -> float:
    """Return the tolerance of the goal error from its noise in the last frames, never below noise of detection.

    Its noise is what it differs by from the way that the moving nodes were followed to the end.
    """
    norms, noises = list[float](), list[float]()
    for frame in selected_frames(member, list(last), len(last)):
        select_out = torch.zeros(frame.graph.instance_index.shape[1])
        scored = ScoredInstances(name, member, frame.graph, select_out, select_out)
        features = frame.index[:, 0].tolist()
        instance = scored.find(features)
        assert instance is not None
        association = scored.association(instance, features)
        goal = association.goal
        if goal is not None:
            end = "final_space" if member.kernel.in_space else "final_xy"
            ends = tuple(
                tuple(frame.graph[f"{kind}_{end}"][row].tolist()) if moves else None
                for kind, row, moves in zip(member.kernel.roles, features, member.goal.moving.tolist(), strict=True)
            )
            if member.kernel.in_space:
                followed = goal_in_space(member, association.nodes, ends)
            else:
                (followed,) = goals_of(member, [association.nodes], [ends], member.reference_axis)
            if not np.isfinite(followed.error).all():
                continue
            norms.append(float(np.linalg.norm(np.subtract(goal.error, followed.error))))
            noises.append(float(np.linalg.norm(goal.std)))
    resolved = NOISE_FACTOR * member.kernel.resolution / 2
    if not norms:
        return resolved
    return max(resolved, SPREAD_FACTOR * float(np.median(norms)), NOISE_FACTOR * float(np.median(noises)))


def _middle(geometry: Float[Tensor, "n g"]) -> Float[Tensor, "n 2"]:
    middle: Tensor = geometry.reshape(len(geometry), geometry.shape[1] // 2, 2).mean(dim=1)
    return middle
