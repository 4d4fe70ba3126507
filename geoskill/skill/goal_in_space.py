"""Where the moving points of an association in space belong, in the frame of their target, and the way that is left.

In the demonstration's last frames, the moving points lay somewhere beside their target, as seen from it. The target's
points, matched by their descriptors, tell its rigid motion T since then (:mod:`geoskill.geometry.rigid_map`), however
target or camera turned::

    goal error = E(moving, resting) - E(T moving*, resting)

with moving* the moving points at the demonstration's end. In pictures the same needs a plane; in space it is exact.
Whatever cannot be told for sure has no goal error: lines and planes that move have none yet.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import Final, final

import numpy as np
import torch
from jaxtyping import Float64
from torch import Tensor

from geoskill.geometry.depth_camera import DepthCamera
from geoskill.geometry.primitives import NodeType
from geoskill.geometry.rigid_map import anchored_motion
from geoskill.geometry.uncertainty import propagated_std
from geoskill.graphs.motif_graph import MotifGraph
from geoskill.model.kernel_model import KernelModel
from geoskill.skill.association import Goal, Node
from geoskill.skill.goal import LOOK_ALIKE_SHARE, MAX_CANDIDATES, MIN_AGREEMENT, descriptor_differences

TOLERANCE_M: Final = 0.008
"""Distance at which two places of one point agree: three standard deviations of two depths at 0.7 m from a D435."""

Places = tuple[tuple[float, ...] | None, ...]
"""Place in space of each moving node at the goal; None for resting nodes."""


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
        self._motions: dict[int, Float64[np.ndarray, "4 4"] | None] = {}
        self._descriptors: np.ndarray = np.zeros((0, 0), np.float32)
        self._space = np.zeros((0, 3))
        if NodeType.POINT in member.node_types:
            self._descriptors = graph[f"{NodeType.POINT}_descriptor"].numpy(force=True)
            self._space = graph[f"{NodeType.POINT}_space"].numpy(force=True).astype(np.float64)

    def goals(self, features: Sequence[Sequence[int]], nodes: Sequence[Sequence[Node]]) -> list[Goal | None]:
        """Return the goals of associations, None where one cannot be told.

        Args:
            features: of the nodes of each association, in this frame.
            nodes: of each association, the moving ones first, with their places in space.
        """
        places = [self._places(own) for own in features]
        return [
            None if own is None else goal_in_space(self._member, own_nodes, own, self._camera)
            for own_nodes, own in zip(nodes, places, strict=True)
        ]

    def _places(self, features: Sequence[int]) -> Places | None:
        kernel, moving = self._member.kernel, self._reference.moving.tolist()
        if not self._reference.is_fitted or len(moving) != len(features):
            return None
        resting = moving.index(False)
        moving_types = {role for role, moves in zip(kernel.roles, moving, strict=True) if moves}
        if moving_types != {NodeType.POINT} or kernel.roles[resting] is not NodeType.POINT:
            return None
        anchor = features[resting]
        if anchor not in self._motions:
            self._motions[anchor] = self._motion(anchor)
        motion = self._motions[anchor]
        if motion is None:
            return None
        places: list[tuple[float, ...] | None] = [None] * len(features)
        for node, moves in enumerate(moving):
            if moves:
                end = self._end(node, features[node])
                if end is None:
                    return None
                places[node] = tuple((motion[:3, :3] @ end + motion[:3, 3]).tolist())
        return tuple(places)

    def _motion(self, anchor: int) -> Float64[np.ndarray, "4 4"] | None:
        """Return the motion of the target since the demonstration's end, through one of its points."""
        stored, ends = (rows.numpy(force=True) for rows in self._reference.surroundings(NodeType.POINT))
        known = np.flatnonzero(np.isfinite(self._space).all(axis=1))
        if len(stored) == 0 or len(known) == 0 or anchor not in known:
            return None
        difference = descriptor_differences(self._descriptors[known], stored)
        nearest = np.argsort(difference, axis=1, kind="stable")[:, :MAX_CANDIDATES]
        similar = np.take_along_axis(difference, nearest, axis=1) <= self._reference.similar(NodeType.POINT)
        row, column = np.nonzero(similar)
        source, target = ends[nearest[row, column]].astype(np.float64), self._space[known[row]]
        feature = known[row]
        own = feature == anchor
        for candidate in source[own]:
            for motion in self._motions.values():  # points of one thing have one motion
                if motion is not None:
                    moved = motion[:3, :3] @ candidate + motion[:3, 3]
                    if np.linalg.norm(moved - self._space[anchor]) <= TOLERANCE_M:
                        return motion
            found = anchored_motion(
                (candidate, self._space[anchor]), source[~own], target[~own], feature[~own], TOLERANCE_M
            )
            if found is not None:
                return found
        return None

    def _end(self, node: int, feature: int) -> Float64[np.ndarray, "3"] | None:
        """Return where a moving point lay at the end of the demonstration; None where look-alikes lay elsewhere."""
        stored, ends = (rows.numpy(force=True) for rows in self._reference.node(node))
        difference = descriptor_differences(self._descriptors[[feature]], stored)[0]
        similar = self._reference.similar(NodeType.POINT)
        candidates = difference <= min(similar, float(difference.min()) + LOOK_ALIKE_SHARE * similar)
        if not candidates.any():
            return None
        places = ends[candidates].astype(np.float64)
        near = np.linalg.norm(places - np.median(places, axis=0), axis=1) <= TOLERANCE_M
        return np.asarray(places[near].mean(axis=0)) if near.mean() >= MIN_AGREEMENT else None


def goal_in_space(
    member: KernelModel, nodes: Sequence[Node], places: Places, camera: DepthCamera | None = None
) -> Goal:
    """Return what is left until the moving points of an association are at places in space.

    Args:
        member: gives the error and the tolerance.
        nodes: with their places in space.
        places: of the moving ones at the goal.
        camera: to show these in the picture, or None.
    """
    kernel = member.kernel
    present = [torch.tensor([node.space]) for node in nodes]
    covariances = [torch.tensor([node.space_covariance]) for node in nodes]
    moving = [node for node, place in enumerate(places) if place is not None]

    def difference(given: Sequence[Tensor]) -> Tensor:
        now, goals = list(given[: len(present)]), list(given[: len(present)])
        for node, rows in zip(moving, given[len(present) :], strict=True):
            goals[node] = rows
        return kernel.control_error(now) - kernel.control_error(goals)

    given = [*present, *(torch.tensor([places[node]]) for node in moving)]
    std = propagated_std(difference, given, [*covariances, *(covariances[node] for node in moving)])
    shown = tuple(
        None if place is None or camera is None else tuple(camera.project(np.array(place)).tolist()) for place in places
    )
    return Goal(
        shown,
        tuple(difference(given)[0].tolist()),
        tuple(std[0].tolist()),
        float(member.goal.tolerance),
        places,
    )


def moved_goal(member: KernelModel, goal: Goal, before: Sequence[Node], nodes: Sequence[Node]) -> Goal | None:
    """Return a goal that moved along with the resting point of an association; None where it cannot be told.

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
    shift = np.subtract(now, last)
    places = tuple(None if place is None else tuple((np.array(place) + shift).tolist()) for place in goal.space)
    moved = goal_in_space(member, nodes, places)
    pixels = np.subtract(nodes[resting].center, before[resting].center)
    return replace(moved, nodes=tuple(own and tuple((np.array(own) + pixels).tolist()) for own in goal.nodes))
