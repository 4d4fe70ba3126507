"""Strict accuracy: whether an association joins features that meet when the task is done.

An association of the object with the target may still join the wrong points of the two. The control error of a right
one is zero when the task is done. Ground truth from simulation knows the position of every point of the object and the
target then: the features of an association are moved to the goal, and the kernel's error is computed there: in the
picture for a kernel of the picture, in space for one of space. In space the parts of an association may stay apart,
such as the lid of a box and the tile under it: where the skill knows how they were in the demonstration, the error is
what is missing to that.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import final

import numpy as np
import torch
from jaxtyping import Bool, Float64, Int64
from torch import Tensor

from geoskill.evaluation.labels import FrameLabels
from geoskill.features.feature_set import FeatureSet
from geoskill.geometry.primitives import NodeType
from geoskill.kernels.kernel import Kernel, instances_in_space, node_dim
from geoskill.simulation.roles import SceneRole
from geoskill.skill.association import Node

STRICT_M = 0.003
"""Largest error at the goal of a right association, in the picture perpendicular to the line of sight: 3 mm."""

_TASK_ROLES = (SceneRole.OBJECT, SceneRole.TARGET)


@final
@dataclass(frozen=True)
class GoalResult:
    """Evaluation of an association at the goal.

    Attributes:
        error_m: norm of the control error at the goal in meters; None when a node is on neither object nor target.
        feasible: whether some instance among the features of the frame joins object and target with an error of at most
            :data:`STRICT_M` at the goal; or joins them at all, where they may stay apart.
    """

    error_m: float | None
    feasible: bool


def evaluate_at_goal(
    kernel: Kernel,
    nodes: tuple[Node, ...],
    features: Mapping[NodeType, FeatureSet],
    labels: FrameLabels,
    apart: Sequence[float] | None = None,
) -> GoalResult | None:
    """Return the error of an association at the goal, or None when the labels do not know it or it is no length.

    The norm is over all components: of two lines that are parallel at a distance h it is h * sqrt(2), since both
    components are h. An association within one thing has the same error at the goal as before and is never right; the
    caller has to check that the association joins object and target.

    Args:
        kernel: kernel of the association.
        nodes: its nodes; empty where nothing is selected.
        features: features of the frame, of the kernel's node types.
        labels: ground truth of the frame.
        apart: the control error of the association when the task is done, as the skill says, for a kernel in space; by
            default zero.
    """
    pixel_m = labels.goal_pixel_m
    if pixel_m is None or kernel.unit not in ("px", "m"):
        return None
    errors_m, joins = errors_at_goal(kernel, features, labels, pixel_m)
    if kernel.in_space and apart is not None:
        feasible = bool(joins.any())
    else:
        feasible = bool((joins & (errors_m <= STRICT_M)).any())
    nodes_at_goal = []
    for node in nodes:
        coordinates = _at_goal(node, labels, kernel.in_space)
        if coordinates is None:
            return GoalResult(None, feasible)
        nodes_at_goal.append(torch.tensor([coordinates], dtype=torch.float64))
    if not nodes_at_goal:
        return GoalResult(None, feasible)
    unit_m = pixel_m if kernel.unit == "px" else 1.0
    error = kernel.control_error(nodes_at_goal)[0]
    if kernel.in_space and apart is not None:
        error = error - torch.tensor(apart, dtype=error.dtype)
    return GoalResult(float(error.norm()) * unit_m, feasible)


def errors_at_goal(
    kernel: Kernel, features: Mapping[NodeType, FeatureSet], labels: FrameLabels, pixel_m: float
) -> tuple[Float64[Tensor, " m"], Bool[Tensor, " m"]]:
    """Return the error at the goal of every instance among a frame's features, and whether it joins object and target.

    Args:
        kernel: kernel whose error is in pixels or in meters.
        features: features of the frame, of the kernel's node types.
        labels: ground truth of the frame, including the goal.
        pixel_m: width of a pixel in meters, :attr:`FrameLabels.goal_pixel_m`.

    Returns:
        Norms of the errors in meters, undefined for instances with a node on neither object nor target; and which
        instances have all of their nodes on the two, and at least one on each.
    """
    coordinates, sides = {}, {}  # a side is 1 on the object, -1 on the target, 0 elsewhere
    for node_type, feature_set in features.items():
        dim = node_dim(kernel, node_type)
        rows, roles = [], []
        for place, space in zip(feature_set.geometry.tolist(), _spaces(feature_set), strict=True):
            at_goal = _at_goal(Node(node_type, tuple(place), space=space), labels, kernel.in_space)
            known = at_goal is not None
            roles.append(labels.feature_label(node_type, place, among=_TASK_ROLES) if known else None)
            rows.append(at_goal or [0.0] * dim)
        coordinates[node_type] = torch.tensor(rows, dtype=torch.float64).reshape(len(rows), dim)
        sides[node_type] = torch.tensor([(role is SceneRole.OBJECT) - (role is SceneRole.TARGET) for role in roles])
    nodes = list(zip(kernel.roles, _instances(kernel, features), strict=True))
    errors = kernel.control_error([coordinates[node_type][index] for node_type, index in nodes])
    node_sides = torch.stack([sides[node_type][index] for node_type, index in nodes])
    joins = (node_sides != 0).all(dim=0) & (node_sides == 1).any(dim=0) & (node_sides == -1).any(dim=0)
    return errors.norm(dim=1) * (pixel_m if kernel.unit == "px" else 1.0), joins


def _instances(kernel: Kernel, features: Mapping[NodeType, FeatureSet]) -> Int64[Tensor, "k m"]:
    """Return the instances that a skill would choose from."""
    if not kernel.in_space:
        return kernel.instances({node_type: len(feature_set) for node_type, feature_set in features.items()})
    places = {
        node_type: torch.from_numpy(np.array(_spaces(feature_set), np.float32).reshape(-1, node_type.space_dim))
        for node_type, feature_set in features.items()
    }
    return instances_in_space(kernel, places)


def _spaces(features: FeatureSet) -> list[tuple[float, ...]]:
    """Return the features in space, NaN where the depth is not known or there is none."""
    dim = features.node_type.space_dim
    return (
        [(float("nan"),) * dim] * len(features) if features.space is None else list(map(tuple, features.space.tolist()))
    )


def _at_goal(node: Node, labels: FrameLabels, in_space: bool) -> list[float] | None:
    """Return a node's coordinates at the goal, or None when one of its points is on neither object nor target."""
    if in_space or node.node_type is NodeType.CONIC:
        feature = labels.feature_at_goal(node.node_type, node.coordinates, node.space, in_space)
        return None if feature is None else list(feature)
    xy = node.coordinates
    points = labels.at_goal([(xy[index], xy[index + 1]) for index in range(0, len(xy), 2)])
    known = [point for point in points or () if point is not None]
    return [value for point in known for value in point] if points is not None and len(known) == len(points) else None
