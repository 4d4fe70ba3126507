"""Where the moving nodes of an association in space belong, in the frame of their target, and the way that is left.

In the demonstration's last frames, the moving features lay somewhere beside their target, as seen from it. The target's
rigid motion T since then (:mod:`geoskill.skill.target_motion`) takes them along, however target or camera turned::

    goal error = E(moving, resting) - E(T moving*, resting)

with moving* the moving features at the demonstration's end. In pictures the same needs a plane; in space it is exact.
Of a point and a plane, E(T moving*, T resting*) is the same for every T: it needs no motion but that both are
recognized. Two lines that come into one plane (copl2) have none: the sign of their error hangs on the order of the
lines' ends, which nothing fixes where they are at right angles. Whatever else cannot be told for sure has none either.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Final, final

import numpy as np
import torch
from jaxtyping import Float32, Float64
from torch import Tensor

from geoskill.geometry.depth_camera import DepthCamera
from geoskill.geometry.primitives import NodeType
from geoskill.geometry.space_places import distances_in_space, laid_over, moved_place, shift_between
from geoskill.geometry.uncertainty import propagated_std
from geoskill.graphs.motif_graph import MotifGraph
from geoskill.kernels.kernel import Kernel
from geoskill.model.kernel_model import KernelModel
from geoskill.skill.association import Goal, Node
from geoskill.skill.goal import LOOK_ALIKE_SHARE, MIN_AGREEMENT, descriptor_differences
from geoskill.skill.target_motion import TOLERANCE_M, TargetMotions

Places = tuple[tuple[float, ...] | None, ...]
"""Place in space of each moving node at the goal; None for resting nodes."""
POINT_AND_PLANE: Final = {NodeType.POINT, NodeType.PLANE}


def has_goal_in_space(kernel: Kernel) -> bool:
    """Return whether a goal error can be told for a kernel in space: for all but two lines that come into a plane."""
    return set(kernel.roles) != {NodeType.LINE} or kernel.error_dim > 1


@final
class SpaceGoalFinder:
    """Goals of the associations of one member in space in one frame.

    Args:
        member: with its goal reference.
        graph: of the frame.
        camera: of the frame, to show the goals in the picture; None where they need not be shown.
    """

    def __init__(self, member: KernelModel, graph: MotifGraph, camera: DepthCamera | None) -> None:
        self._member, self._reference, self._camera = member, member.goal, camera
        self._motions = TargetMotions(member, graph)

    def goals(self, features: Sequence[Sequence[int]], nodes: Sequence[Sequence[Node]]) -> list[Goal | None]:
        """Return the goals of associations, None where one cannot be told.

        Args:
            features: of the nodes of each association, in this frame.
            nodes: of each association, the moving ones first, with their places in space.
        """
        places = [self._places(own, own_nodes) for own, own_nodes in zip(features, nodes, strict=True)]
        return [
            None if own is None else goal_in_space(self._member, own_nodes, own, self._camera)
            for own_nodes, own in zip(nodes, places, strict=True)
        ]

    def _places(self, features: Sequence[int], nodes: Sequence[Node]) -> Places | None:
        kernel, moving = self._member.kernel, self._reference.moving.tolist()
        if not self._reference.is_fitted or len(moving) != len(features) or not has_goal_in_space(kernel):
            return None
        if set(kernel.roles) == POINT_AND_PLANE:
            return self._place_at_distance(features, nodes)
        resting = moving.index(False)
        motion = self._motions.of(kernel.roles[resting], features[resting])
        if motion is None:
            return None
        places: list[tuple[float, ...] | None] = [None] * len(features)
        for node, moves in enumerate(moving):
            if moves:
                end = self._end(node, features[node])
                if end is None:
                    return None
                places[node] = tuple(moved_place(kernel.roles[node], end, motion).tolist())
        return tuple(places)

    def _end(self, node: int, feature: int) -> Float64[np.ndarray, " s"] | None:
        """Return where a moving feature lay at the end of the demonstration; None where look-alikes lay elsewhere."""
        kind = self._member.kernel.roles[node]
        rows, difference = self._candidates(node, feature)
        if len(rows) == 0:
            return None
        places = self._reference.node(node)[1].numpy(force=True)[rows].astype(np.float64)
        if kind is NodeType.LINE:
            best: Float64[np.ndarray, " s"] = places[int(difference.argmin())]
            near = distances_in_space(kind, places, best) <= TOLERANCE_M
            return best if near.mean() >= MIN_AGREEMENT else None
        near = distances_in_space(kind, places, np.median(places, axis=0)) <= TOLERANCE_M
        return np.asarray(places[near].mean(axis=0)) if near.mean() >= MIN_AGREEMENT else None

    def _candidates(self, node: int, feature: int) -> tuple[np.ndarray, Float32[np.ndarray, " c"]]:
        """Return the stored instances whose node may be a feature of the frame, and how much they differ from it."""
        kind = self._member.kernel.roles[node]
        stored = self._reference.node(node)[0].numpy(force=True)
        difference = descriptor_differences(self._motions.descriptor(kind, feature), stored)[0]
        similar = self._reference.similar(kind)
        rows = np.flatnonzero(difference <= min(similar, float(difference.min()) + LOOK_ALIKE_SHARE * similar))
        return rows, np.asarray(difference[rows], np.float32)

    def _place_at_distance(self, features: Sequence[int], nodes: Sequence[Node]) -> Places | None:
        """Return the nearest place of a moving point or plane where it is as far from the other as in the end."""
        kernel, moving = self._member.kernel, self._reference.moving.tolist()
        both = set(self._candidates(0, features[0])[0]) & set(self._candidates(1, features[1])[0])
        if not both:
            return None
        ends = [self._reference.node(node)[1][sorted(both)] for node in range(2)]
        distances = kernel.control_error(ends)[:, 0].numpy(force=True)
        near = np.abs(distances - np.median(distances)) <= TOLERANCE_M
        if near.mean() < MIN_AGREEMENT:
            return None
        wanted = float(distances[near].mean())
        present = [torch.tensor([node.space], dtype=torch.float64) for node in nodes]
        left = float(kernel.control_error(present)[0, 0]) - wanted
        normal = present[kernel.roles.index(NodeType.PLANE)][0, :3].numpy()
        away = np.eye(4)
        mover = moving.index(True)
        away[:3, 3] = -left * normal if kernel.roles[mover] is NodeType.POINT else left * normal
        place = tuple(moved_place(kernel.roles[mover], present[mover][0].numpy(), away).tolist())
        return tuple(place if moves else None for moves in moving)


def goal_in_space(
    member: KernelModel, nodes: Sequence[Node], places: Places, camera: DepthCamera | None = None
) -> Goal:
    """Return what is left until the moving nodes of an association are at places in space.

    Lines are laid where they reach nearest to where they are now, as long as they are seen now.

    Args:
        member: gives the error and the tolerance.
        nodes: with their places in space.
        places: of the moving ones at the goal.
        camera: to show these in the picture, or None. Planes are not shown.
    """
    kernel = member.kernel
    present = [torch.tensor([node.space]) for node in nodes]
    covariances = [torch.tensor([node.space_covariance]) for node in nodes]
    moving = [node for node, place in enumerate(places) if place is not None]
    at_goal = _as_seen(nodes, places)

    def difference(given: Sequence[Tensor]) -> Tensor:
        now, goals = list(given[: len(present)]), list(given[: len(present)])
        for node, rows in zip(moving, given[len(present) :], strict=True):
            goals[node] = rows
        return kernel.control_error(now) - kernel.control_error(goals)

    given = [*present, *(torch.tensor([at_goal[node]]) for node in moving)]
    std = propagated_std(difference, given, [*covariances, *(covariances[node] for node in moving)])
    return Goal(
        tuple(_shown(node, place, camera) for node, place in zip(nodes, at_goal, strict=True)),
        tuple(difference(given)[0].tolist()),
        tuple(std[0].tolist()),
        float(member.goal.tolerance),
        places,
    )


def _as_seen(nodes: Sequence[Node], places: Places) -> Places:
    """Return places whose lines are as long as they are seen, and directed like the last resting line, or the node."""
    resting = [node.space for node, place in zip(nodes, places, strict=True) if place is None]
    result: list[tuple[float, ...] | None] = []
    for node, place in zip(nodes, places, strict=True):
        if place is not None and node.node_type is NodeType.LINE:
            line = laid_over(np.array(place), np.array(node.space))
            reference = np.array(resting[-1] if resting[-1] is not None and len(resting[-1]) == 6 else node.space)
            if (line[3:] - line[:3]) @ (reference[3:] - reference[:3]) < 0:
                line = np.roll(line, 3)
            place = tuple(line.tolist())
        result.append(place)
    return tuple(result)


def _shown(node: Node, place: tuple[float, ...] | None, camera: DepthCamera | None) -> tuple[float, ...] | None:
    """Return a place in the picture, or None where it is not shown."""
    if place is None or camera is None or node.node_type is NodeType.PLANE:
        return None
    return tuple(value for point in np.reshape(place, (-1, 3)) for value in camera.project(point).tolist())


def moved_goal(member: KernelModel, goal: Goal, before: Sequence[Node], nodes: Sequence[Node]) -> Goal | None:
    """Return a goal that moved along with the resting node of an association; None where it cannot be told.

    Args:
        member: gives the error.
        goal: as of the frame before.
        before: nodes of the frame before, with their places in space.
        nodes: where they are tracked to, with their places in space.
    """
    resting = goal.space.index(None)
    last, now = before[resting].space, nodes[resting].space
    if last is None or now is None:
        return None
    motion = np.eye(4)
    motion[:3, 3] = shift_between(nodes[resting].node_type, np.array(last), np.array(now))
    places = tuple(
        None if place is None else tuple(moved_place(node.node_type, np.array(place), motion).tolist())
        for node, place in zip(nodes, goal.space, strict=True)
    )
    moved = goal_in_space(member, nodes, places)
    pixels = np.subtract(nodes[resting].center, before[resting].center)
    shown = [own and tuple((np.reshape(own, (-1, 2)) + pixels).ravel().tolist()) for own in goal.nodes]
    return replace(moved, nodes=tuple(shown))
