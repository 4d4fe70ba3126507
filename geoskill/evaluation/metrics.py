"""Correctness of a skill's top associations on labeled frames, and metrics over a sequence.

An association is right when it joins the object and the target: every node is on one of them, and each has a node.
Points count by themselves, lines by their midpoints. Frames whose features allow no right association are infeasible
and do not count in the accuracy.
"""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from statistics import median
from typing import Any, final

from geoskill.evaluation.calibration import expected_calibration_error, reliability
from geoskill.evaluation.consistency import autocorrelation
from geoskill.evaluation.goal import STRICT_M, GoalResult, evaluate_at_goal
from geoskill.evaluation.labels import TOLERANCE_PX, FrameLabels
from geoskill.evaluation.switches import SwitchCount
from geoskill.features.feature_set import FeatureSet
from geoskill.geometry.primitives import NodeType
from geoskill.kernels.kernel import Kernel, node_types
from geoskill.model.kernel_model import KernelModel
from geoskill.simulation.roles import SceneRole
from geoskill.skill.association import Association, InferenceResult, Node

# Correctness depends on these alone; nodes on the hand are reported separately.
_TASK_ROLES = (SceneRole.OBJECT, SceneRole.TARGET)
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
class FrameResult:
    """Evaluation of one ensemble member on one frame.

    Attributes:
        frame: number of the frame.
        has_association: whether the member selected anything.
        feasible: whether the detected features allow a right association.
        correct: whether the top association is right.
        hits_hand: whether a node of the top association is on the agent, a hand or a gripper.
        confidence: confidence of the top association; 0 without one.
        rsw: residual sum of weights, 1 minus the weights of the listed associations; 1 without any.
        error: norm of the top association's control error, in the unit of the kernel; None without one.
        goal: evaluation of the top association at the goal; None when the labels do not include the goal.
    """

    frame: int
    has_association: bool
    feasible: bool
    correct: bool
    hits_hand: bool
    confidence: float
    rsw: float
    error: float | None = None
    goal: GoalResult | None = None

    @property
    def strict(self) -> bool | None:
        """Whether the top association is right and its error at the goal at most 3 mm; None when it is unknown."""
        if self.goal is None:
            return None
        return self.correct and self.goal.error_m is not None and self.goal.error_m <= STRICT_M


def evaluate_frame(
    frame: int,
    result: InferenceResult,
    labels: FrameLabels,
    name: str,
    member: KernelModel,
    tolerance_px: float = TOLERANCE_PX,
) -> FrameResult:
    """Evaluate one member of an ensemble on one frame.

    A node is on the hand when :meth:`FrameLabels.label` over all roles says so. A node on the hand that is within the
    tolerance of the object counts as a hand hit, though it may count as on the object for correctness, which considers
    the object and the target alone: accuracy and hand rate may add up to more than 1.

    Args:
        frame: number of the frame.
        result: result of the whole ensemble.
        labels: ground truth of the frame.
        name: name of the member.
        member: kernel and extractors of the member.
        tolerance_px: see :meth:`FrameLabels.label`.

    Raises:
        ValueError: when the result lacks the features of one of the member's extractors, or they are of another type.
    """
    listed = [association for association in result.associations if association.member == name]
    top = top_association(result, name)
    features = _member_features(result, member)
    nodes = () if top is None else top.nodes
    return FrameResult(
        frame=frame,
        has_association=top is not None,
        feasible=is_feasible(member.kernel, features, labels, tolerance_px),
        correct=joins_object_and_target(nodes, labels, tolerance_px),
        hits_hand=any(
            labels.feature_label(node.node_type, node.coordinates, tolerance_px) is SceneRole.AGENT for node in nodes
        ),
        confidence=0.0 if top is None else float(top.confidence),
        rsw=_residual_sum_of_weights(listed),
        error=None if top is None else math.hypot(*top.error),
        goal=evaluate_at_goal(member.kernel, nodes, features, labels, _apart_at_goal(top)),
    )


def top_association(result: InferenceResult, member: str) -> Association | None:
    """Return the member's association of rank 1, or None when it selected nothing."""
    return next(
        (association for association in result.associations if (association.member, association.rank) == (member, 1)),
        None,
    )


def _apart_at_goal(association: Association | None) -> list[float] | None:
    """Return the error that an association has when the task is done, as it says itself, or None."""
    if association is None or association.goal is None:
        return None
    return [now - left for now, left in zip(association.error, association.goal.error, strict=True)]


def joins_object_and_target(nodes: Sequence[Node], labels: FrameLabels, tolerance_px: float = TOLERANCE_PX) -> bool:
    """Return whether every node is on the object or the target and each of the two has one; False without nodes."""
    found = {labels.feature_label(node.node_type, node.coordinates, tolerance_px, _TASK_ROLES) for node in nodes}
    return found == set(_TASK_ROLES)


def is_feasible(
    kernel: Kernel,
    features: Mapping[NodeType, FeatureSet],
    labels: FrameLabels,
    tolerance_px: float = TOLERANCE_PX,
) -> bool:
    """Return whether some choice of distinct features for the kernel's nodes joins the object and the target.

    For p2l these are a point on the one and a line on the other, either way round.
    """
    fewest_on_object = most_on_object = 0
    for node_type in node_types(kernel):
        needed = kernel.roles.count(node_type)
        roles = [
            labels.feature_label(node_type, row, tolerance_px, _TASK_ROLES)
            for row in features[node_type].geometry.tolist()
        ]
        on_object, on_target = roles.count(SceneRole.OBJECT), roles.count(SceneRole.TARGET)
        if on_object + on_target < needed:
            return False
        fewest_on_object += max(0, needed - on_target)
        most_on_object += min(needed, on_object)
    # Any number of nodes on the object between the two is possible; one of them must leave a node for the target.
    return max(fewest_on_object, 1) <= min(most_on_object, len(kernel.roles) - 1)


def summarize(frame_results: Sequence[FrameResult], switches: SwitchCount) -> dict[str, Any]:
    """Return one member's metrics over a sequence, as plain numbers for JSON; None where nothing can be averaged.

    ``top1_accuracy`` is over the feasible frames; ``hand_rate``, ``mean_confidence`` and ``rsw`` are over all frames: a
    frame without an association has no hand hit, confidence 0 and RSW 1. ``switches_per_frame`` is over the comparable
    transitions.

    ``precision`` is the fraction of right top associations among the frames with an association, feasible or not;
    ``expected_calibration_error`` and ``reliability`` compare confidence with it
    (:mod:`geoskill.evaluation.calibration`).

    ``strict_accuracy`` is over the frames whose features allow an association with an error of at most 3 mm at the goal
    (``strictly_feasible_frames``); ``goal_error_mm`` is the median error at the goal of right top associations.
    """
    strictly_feasible = [result for result in frame_results if result.goal is not None and result.goal.feasible]
    goal_errors = [
        1000 * result.goal.error_m
        for result in frame_results
        if result.correct and result.goal is not None and result.goal.error_m is not None
    ]
    feasible = [result for result in frame_results if result.feasible]
    outcomes = [(result.confidence, result.correct) for result in frame_results if result.has_association]
    bins = reliability(outcomes)
    return {
        "frames": len(frame_results),
        "feasible_frames": len(feasible),
        "infeasible_frames": len(frame_results) - len(feasible),
        "frames_without_association": sum(not result.has_association for result in frame_results),
        "top1_accuracy": _mean(result.correct for result in feasible),
        "strictly_feasible_frames": len(strictly_feasible) if any(result.goal for result in frame_results) else None,
        "strict_accuracy": _mean(bool(result.strict) for result in strictly_feasible),
        "goal_error_mm": median(goal_errors) if goal_errors else None,
        "hand_rate": _mean(result.hits_hand for result in frame_results),
        "mean_confidence": _mean(result.confidence for result in frame_results),
        "precision": _mean(correct for _, correct in outcomes),
        "expected_calibration_error": expected_calibration_error(bins),
        "reliability": [list(reliability_bin) for reliability_bin in bins],
        "rsw": _mean(result.rsw for result in frame_results),
        "switches": switches.switches,
        "comparable_transitions": switches.comparable,
        "switches_per_frame": switches.switches / switches.comparable if switches.comparable else None,
        "error_autocorrelation": autocorrelation([result.error for result in frame_results]),
    }


def summarize_ensemble(members: Mapping[str, Mapping[str, Any]]) -> dict[str, Any]:
    """Return the metrics of the ensemble, with those of each member by name under ``members``.

    At the top level, a rate is the mean over the members that have one, None when none has; counts are those of the
    first member.
    """
    metrics: dict[str, Any] = dict(next(iter(members.values())))
    for key in _RATES:
        metrics[key] = _mean(member[key] for member in members.values() if member.get(key) is not None)
    return {**metrics, "members": {name: dict(member) for name, member in members.items()}}


def _residual_sum_of_weights(associations: Iterable[Association]) -> float:
    ranked = sorted(associations, key=lambda association: association.rank)
    return min(1.0, max(0.0, 1.0 - sum(float(association.weight) for association in ranked)))


def _member_features(result: InferenceResult, member: KernelModel) -> dict[NodeType, FeatureSet]:
    features = {}
    for node_type, extractor in member.extractors.items():
        if extractor not in result.features:
            raise ValueError(f"no features of {extractor!r} in the result; expected one of {sorted(result.features)}")
        features[node_type] = result.features[extractor]
        if features[node_type].node_type is not node_type:
            raise ValueError(
                f"{extractor!r} yields {features[node_type].node_type} features; expected {node_type} for"
                f" {member.kernel.name}"
            )
    return features


def _mean(values: Iterable[float]) -> float | None:
    numbers = [float(value) for value in values]
    return sum(numbers) / len(numbers) if numbers else None
