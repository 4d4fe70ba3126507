"""How right a skill's top associations are on labeled frames.

An association is right when it joins the object and the target: every node lies on one of them, and each has a node.
Points count by themselves, lines by their midpoints. Frames whose features allow no right association are infeasible
and left out of the accuracy.
"""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from statistics import median
from typing import Any, final

from geoskill.evaluation.calibration import expected_calibration_error, reliability
from geoskill.evaluation.consistency import autocorrelation
from geoskill.evaluation.goal import STRICT_M, GoalVerdict, judge_at_goal
from geoskill.evaluation.labels import TOLERANCE_PX, FrameLabels, Region
from geoskill.evaluation.switches import SwitchCount
from geoskill.features.feature_set import FeatureSet
from geoskill.geometry.primitives import NodeType, centers
from geoskill.kernels.kernel import Kernel, node_types
from geoskill.skill.association import Association, InferenceResult, Node

# The hand has no say in whether an association is right; it is reported beside that.
_TASK_REGIONS = (Region.OBJECT, Region.TARGET)
_RATES = (
    "top1_accuracy",
    "strict_accuracy",
    "goal_error_mm",
    "oracle_strict_accuracy",
    "oracle_goal_error_mm",
    "hand_rate",
    "mean_confidence",
    "expected_calibration_error",
    "precision",
    "rsw",
    "switches_per_frame",
    "error_autocorrelation",
)


@final
@dataclass(frozen=True)
class FrameVerdict:
    """What one ensemble member made of one frame.

    Attributes:
        frame: number of the frame.
        has_association: whether the member selected anything at all.
        feasible: whether the detected features allow a right association.
        correct: whether the top association is right.
        hits_hand: whether a node of the top association is on the hand.
        confidence: that of the top association; 0 without one.
        rsw: residual sum of weights, 1 minus the weights of the listed associations; 1 without any.
        error: norm of the top association's control error, or None without one.
        goal: what becomes of the top association when the task is done; None where the labels do not know.
    """

    frame: int
    has_association: bool
    feasible: bool
    correct: bool
    hits_hand: bool
    confidence: float
    rsw: float
    error: float | None = None
    goal: GoalVerdict | None = None

    @property
    def strict(self) -> bool | None:
        """Whether the top association is right, and its error 3 mm at most when the task is done."""
        if self.goal is None:
            return None
        return self.correct and self.goal.error_m is not None and self.goal.error_m <= STRICT_M


def judge_frame(
    frame: int,
    result: InferenceResult,
    regions: FrameLabels,
    kernel: Kernel,
    descriptor: str,
    tolerance_px: float = TOLERANCE_PX,
) -> FrameVerdict:
    """The verdict on the member (``kernel``, ``descriptor``) of an ensemble.

    A node is on the hand when :meth:`FrameLabels.label` over all three regions says so. A node on the hand that is
    within the tolerance of the object thus makes a hand hit, though it may count as the object's for correctness, which
    asks for the object and the target alone: accuracy and hand rate may add up to more than 1.
    """
    listed = member_associations(result, kernel, descriptor)
    top = top_association(result, kernel, descriptor)
    features = _member_features(result, kernel, descriptor)
    nodes = () if top is None else top.nodes
    return FrameVerdict(
        frame=frame,
        has_association=top is not None,
        feasible=is_feasible(kernel, features, regions, tolerance_px),
        correct=joins_object_and_target(nodes, regions, tolerance_px),
        hits_hand=any(regions.label(node.center, tolerance_px) is Region.HAND for node in nodes),
        confidence=0.0 if top is None else float(top.confidence),
        rsw=min(1.0, max(0.0, 1.0 - sum(float(association.weight) for association in listed))),
        error=None if top is None else math.hypot(*top.error),
        goal=judge_at_goal(kernel, nodes, features, regions),
    )


def member_associations(result: InferenceResult, kernel: Kernel, descriptor: str) -> list[Association]:
    """What one member of the ensemble listed, in the order of the ranks."""
    own = [item for item in result.associations if (item.kernel, item.descriptor) == (kernel.name, descriptor)]
    return sorted(own, key=lambda association: association.rank)


def top_association(result: InferenceResult, kernel: Kernel, descriptor: str) -> Association | None:
    """The member's association of rank 1, or None where it has no instance."""
    return next((item for item in member_associations(result, kernel, descriptor) if item.rank == 1), None)


def joins_object_and_target(nodes: Sequence[Node], regions: FrameLabels, tolerance_px: float = TOLERANCE_PX) -> bool:
    """Whether every node is on the object or the target and each of the two has one; False without nodes."""
    return {regions.label(node.center, tolerance_px, _TASK_REGIONS) for node in nodes} == set(_TASK_REGIONS)


def is_feasible(
    kernel: Kernel,
    features: Mapping[NodeType, FeatureSet],
    regions: FrameLabels,
    tolerance_px: float = TOLERANCE_PX,
) -> bool:
    """Whether some choice of distinct features for the kernel's nodes joins the object and the target.

    For p2l that is a point on the one and a line on the other, either way round.
    """
    fewest_on_object = most_on_object = 0
    for node_type in node_types(kernel):
        needed = kernel.roles.count(node_type)
        labels = [regions.label(center, tolerance_px, _TASK_REGIONS) for center in _centers(features[node_type])]
        on_object, on_target = labels.count(Region.OBJECT), labels.count(Region.TARGET)
        if on_object + on_target < needed:
            return False
        fewest_on_object += max(0, needed - on_target)
        most_on_object += min(needed, on_object)
    # Every number of nodes on the object between the two can be had; wanted is one that leaves a node for the target.
    return max(fewest_on_object, 1) <= min(most_on_object, len(kernel.roles) - 1)


def summarize(verdicts: Sequence[FrameVerdict], switches: SwitchCount) -> dict[str, Any]:
    """One member's figures over a sequence, as plain numbers for JSON; None where there is nothing to average over.

    ``top1_accuracy`` is over the feasible frames, ``hand_rate``, ``mean_confidence`` and ``rsw`` over all of them: a
    frame without any association has no hand hit, confidence 0 and RSW 1. ``switches_per_frame`` is over the comparable
    transitions.

    ``precision`` is the share of right ones among the frames with an association, feasible or not. It is the accuracy
    that ``expected_calibration_error`` and ``reliability`` compare confidence with
    (:mod:`geoskill.evaluation.calibration`).

    ``strict_accuracy`` is over the frames whose features allow an association that meets within 3 mm when the task is
    done (``strictly_feasible_frames``), ``goal_error_mm`` the median error then of right top associations.
    """
    strictly = [verdict for verdict in verdicts if verdict.goal is not None and verdict.goal.feasible]
    goal_errors = [
        1000 * verdict.goal.error_m
        for verdict in verdicts
        if verdict.correct and verdict.goal is not None and verdict.goal.error_m is not None
    ]
    feasible = [verdict for verdict in verdicts if verdict.feasible]
    selected = [(verdict.confidence, verdict.correct) for verdict in verdicts if verdict.has_association]
    bins = reliability(selected)
    return {
        "frames": len(verdicts),
        "feasible_frames": len(feasible),
        "infeasible_frames": len(verdicts) - len(feasible),
        "frames_without_association": sum(not verdict.has_association for verdict in verdicts),
        "top1_accuracy": _mean(verdict.correct for verdict in feasible),
        "strictly_feasible_frames": len(strictly) if any(verdict.goal for verdict in verdicts) else None,
        "strict_accuracy": _mean(bool(verdict.strict) for verdict in strictly),
        "goal_error_mm": median(goal_errors) if goal_errors else None,
        "hand_rate": _mean(verdict.hits_hand for verdict in verdicts),
        "mean_confidence": _mean(verdict.confidence for verdict in verdicts),
        "precision": _mean(right for _, right in selected),
        "expected_calibration_error": expected_calibration_error(bins),
        "reliability": [list(each) for each in bins],
        "rsw": _mean(verdict.rsw for verdict in verdicts),
        "switches": switches.switches,
        "comparable_transitions": switches.comparable,
        "switches_per_frame": switches.switches / switches.comparable if switches.comparable else None,
        "error_autocorrelation": autocorrelation([verdict.error for verdict in verdicts]),
    }


def summarize_ensemble(members: Mapping[str, Mapping[str, Any]]) -> dict[str, Any]:
    """The figures of all members under ``members`` by name, and those of the whole at the top level.

    At the top level, rates are the mean over the members that have one, None where none has; counts are the first
    member's.
    """
    figures: dict[str, Any] = dict(next(iter(members.values())))
    for key in _RATES:
        figures[key] = _mean(member[key] for member in members.values() if member.get(key) is not None)
    return {**figures, "members": {name: dict(member) for name, member in members.items()}}


def _member_features(result: InferenceResult, kernel: Kernel, descriptor: str) -> dict[NodeType, FeatureSet]:
    kinds, names = node_types(kernel), descriptor.split("+")
    if len(names) != len(kinds):
        raise ValueError(
            f"descriptor {descriptor!r} names {len(names)} extractors; expected {len(kinds)} for {kernel.name}, one for"
            f" each of {', '.join(kinds)}"
        )
    features = {}
    for kind, name in zip(kinds, names, strict=True):
        if name not in result.features:
            raise ValueError(f"no features of {name!r} in the result; expected one of {sorted(result.features)}")
        features[kind] = result.features[name]
        if features[kind].node_type is not kind:
            raise ValueError(f"{name!r} yields {features[kind].node_type} features; expected {kind} for {kernel.name}")
    return features


def _centers(features: FeatureSet) -> list[tuple[float, float]]:
    return [(float(x), float(y)) for x, y in centers(features.geometry)]


def _mean(values: Iterable[float]) -> float | None:
    numbers = [float(value) for value in values]
    return sum(numbers) / len(numbers) if numbers else None
