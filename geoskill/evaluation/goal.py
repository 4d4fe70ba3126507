"""Whether an association is right not only about the things but about the places on them: strict accuracy.

A right association is one whose control error is zero when the task is done. Where the ground truth knows where every
point of the object and the target is then (in simulation), the features of an association are carried to the goal, and
the kernel's error is taken there.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import final

import torch
from jaxtyping import Bool, Float64
from torch import Tensor

from geoskill.evaluation.labels import FrameLabels, Region
from geoskill.features.feature_set import FeatureSet
from geoskill.geometry.primitives import NodeType
from geoskill.kernels.kernel import Kernel
from geoskill.skill.association import Node

STRICT_M = 0.003
"""Largest error at the goal of a right association, across the line of sight: 3 mm."""


@final
@dataclass(frozen=True)
class GoalVerdict:
    """What becomes of an association at the goal.

    Attributes:
        error_m: norm of the control error at the goal; None where a node is on neither object nor target.
        feasible: whether some choice among the frame's features has an error of at most :data:`STRICT_M` there.
    """

    error_m: float | None
    feasible: bool


def judge_at_goal(
    kernel: Kernel, nodes: tuple[Node, ...], features: Mapping[NodeType, FeatureSet], labels: FrameLabels
) -> GoalVerdict | None:
    """The verdict on an association, None where the labels do not know the goal or the error is no length.

    The norm is over all components: of two lines that lie parallel at a distance h it is h·√2, since each counts.
    An association within one thing keeps its error whatever is done, and is never right; whoever asks has to make sure
    that it joins the two.
    """
    pixel_m = labels.goal_pixel_m
    if pixel_m is None or kernel.unit != "px":
        return None
    errors_m, joins = errors_at_goal(kernel, features, labels, pixel_m)
    feasible = bool((joins & (errors_m <= STRICT_M)).any())
    own = []
    for node in nodes:
        moved = _at_goal(node, labels)
        if moved is None:
            return GoalVerdict(None, feasible)
        own.append(torch.tensor([moved], dtype=torch.float64))
    if not own:
        return GoalVerdict(None, feasible)
    return GoalVerdict(float(kernel.control_error(own).norm()) * pixel_m, feasible)


def errors_at_goal(
    kernel: Kernel, features: Mapping[NodeType, FeatureSet], labels: FrameLabels, pixel_m: float
) -> tuple[Float64[Tensor, " m"], Bool[Tensor, " m"]]:
    """Of every instance among a frame's features: the norm of its error at the goal, and whether it joins the things.

    Args:
        kernel: with an error in pixels.
        features: of the kernel's node types.
        labels: know the goal.
        pixel_m: :attr:`FrameLabels.goal_pixel_m` of the labels.

    Returns:
        The errors in meters, which mean nothing where a node is on neither object nor target; and which instances have
        all of their nodes on the two, and one on each.
    """
    carried, sides = {}, {}
    for kind, found in features.items():
        rows, on = [], []
        for row in found.geometry.tolist():
            node = Node(kind, tuple(row))
            moved = _at_goal(node, labels)
            on.append(None if moved is None else labels.label(node.center, among=(Region.OBJECT, Region.TARGET)))
            rows.append(moved or [0.0] * len(row))
        carried[kind] = torch.tensor(rows, dtype=torch.float64).reshape(len(rows), kind.geometry_dim)
        sides[kind] = torch.tensor([(side is Region.OBJECT) - (side is Region.TARGET) for side in on])
    instances = kernel.instances({kind: len(found) for kind, found in features.items()})
    errors = kernel.control_error([carried[kind][index] for kind, index in zip(kernel.roles, instances, strict=True)])
    joined = torch.stack([sides[kind][index] for kind, index in zip(kernel.roles, instances, strict=True)])
    joins = (joined != 0).all(dim=0) & (joined == 1).any(dim=0) & (joined == -1).any(dim=0)
    return errors.norm(dim=1) * pixel_m, joins


def _at_goal(node: Node, labels: FrameLabels) -> list[float] | None:
    """A feature's coordinates at the goal; None where one of its points is on neither object nor target."""
    xy = node.coordinates
    moved = labels.at_goal([(xy[place], xy[place + 1]) for place in range(0, len(xy), 2)])
    known = [end for end in moved or () if end is not None]
    return [value for end in known for value in end] if moved is not None and len(known) == len(moved) else None
