"""Tests of frame results and metrics on made-up frames."""

import json
from itertools import combinations, product

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from geoskill.evaluation.goal import GoalResult
from geoskill.evaluation.metrics import (
    FrameResult,
    evaluate_frame,
    is_feasible,
    joins_object_and_target,
    summarize,
    summarize_ensemble,
)
from geoskill.evaluation.regions import FrameRegions
from geoskill.evaluation.switches import SwitchCount
from geoskill.features.feature_set import FeatureSet
from geoskill.geometry.primitives import NodeType
from geoskill.kernels.kernel import Kernel, node_types
from geoskill.kernels.l2l import LineToLine
from geoskill.kernels.p2l import PointToLine
from geoskill.kernels.p2p import PointToPoint
from geoskill.model.bilinear import Bilinear
from geoskill.model.kernel_model import KernelModel
from geoskill.model.scorer import Motif
from geoskill.simulation.roles import SceneRole
from geoskill.skill.association import Association, InferenceResult, Node


def rectangle(left: float, top: float, right: float, bottom: float) -> np.ndarray:
    return np.array([[left, top], [right, top], [right, bottom], [left, bottom]], np.float32)


# Object, target and hand from left to right, each 20 px wide; the hand begins where the object ends.
REGIONS = FrameRegions(
    {
        SceneRole.OBJECT: rectangle(0, 0, 20, 20),
        SceneRole.AGENT: rectangle(20, 0, 40, 20),
        SceneRole.TARGET: rectangle(60, 0, 80, 20),
    }
)
ON_OBJECT, ON_HAND, ON_TARGET, ON_NOTHING = (10.0, 10.0), (30.0, 10.0), (70.0, 10.0), (100.0, 100.0)
NEAR_OBJECT = (22.0, 10.0)  # on the hand, 2 px from the object


def member(kernel: Kernel, *extractors: str) -> KernelModel:
    """Return an untrained member with one extractor for each node type."""
    names = dict(zip(node_types(kernel), extractors, strict=True))
    return KernelModel(kernel, names, Bilinear(Motif.of(kernel, dict.fromkeys(names, 1)), hidden_dim=1))


P2P_SIFT = member(PointToPoint(), "sift")


def point(xy: tuple[float, float]) -> Node:
    return Node(NodeType.POINT, xy)


def line(xy: tuple[float, float]) -> Node:
    """Return a segment of 60 px with this midpoint; its end points are mostly outside the region."""
    return Node(NodeType.LINE, (xy[0] - 30.0, xy[1], xy[0] + 30.0, xy[1]))


def features(node_type: NodeType, nodes: list[Node]) -> FeatureSet:
    geometry = np.array([node.coordinates for node in nodes], np.float32).reshape(-1, node_type.geometry_dim)
    count = len(nodes)
    return FeatureSet(node_type, np.ones((count, 1), np.float32), geometry, np.ones(count, np.float32))


def points(*xy: tuple[float, float]) -> FeatureSet:
    return features(NodeType.POINT, [point(pair) for pair in xy])


def lines(*xy: tuple[float, float]) -> FeatureSet:
    return features(NodeType.LINE, [line(pair) for pair in xy])


def association(*nodes: Node, rank: int = 1, confidence: float = 0.5, member: str = "p2p_sift") -> Association:
    kernel, *extractors = member.split("_")
    return Association(member, kernel, "+".join(extractors), rank, confidence, confidence, nodes, (0.0, 0.0))


def result(features_by_name: dict[str, FeatureSet], *associations: Association) -> InferenceResult:
    return InferenceResult(associations, features_by_name)


@pytest.mark.parametrize(
    ("nodes", "correct"),
    [
        ([point(ON_OBJECT), point(ON_TARGET)], True),
        ([point(ON_TARGET), point(ON_OBJECT)], True),
        ([point(ON_OBJECT), point(ON_OBJECT)], False),
        ([point(ON_TARGET), point(ON_TARGET)], False),
        ([point(ON_HAND), point(ON_TARGET)], False),
        ([point(ON_OBJECT), point(ON_NOTHING)], False),
        ([point(ON_OBJECT), line(ON_TARGET)], True),
        ([line(ON_OBJECT), point(ON_TARGET)], True),
        ([line((10.0, 50.0)), point(ON_TARGET)], False),
        ([point((83.0, 10.0)), point((-3.0, 10.0))], True),  # both exactly the tolerance outside
        ([point((83.1, 10.0)), point((-3.0, 10.0))], False),
        ([point(ON_OBJECT), point(ON_TARGET), point(ON_OBJECT), point(ON_TARGET)], True),
        ([point(ON_OBJECT), point(ON_TARGET), point(ON_OBJECT), point(ON_HAND)], False),
        ([], False),
    ],
)
def test_joins_object_and_target(nodes: list[Node], correct: bool) -> None:
    assert joins_object_and_target(nodes, REGIONS) is correct


def test_evaluate_frame_right_association() -> None:
    features_by_name = {"sift": points(ON_OBJECT, ON_TARGET, ON_HAND)}
    top = association(point(ON_OBJECT), point(ON_TARGET), confidence=0.625)
    second = association(point(ON_HAND), point(ON_TARGET), rank=2, confidence=0.25)
    frame_result = evaluate_frame(7, result(features_by_name, top, second), REGIONS, "p2p_sift", P2P_SIFT)
    assert frame_result == FrameResult(7, True, True, True, False, 0.625, 0.125, error=0.0)


def test_evaluate_frame_takes_rank_one_in_any_order() -> None:
    features_by_name = {"sift": points(ON_OBJECT, ON_TARGET, ON_HAND)}
    top = association(point(ON_OBJECT), point(ON_TARGET), confidence=0.6)
    second = association(point(ON_HAND), point(ON_TARGET), rank=2, confidence=0.3)
    frame_result = evaluate_frame(0, result(features_by_name, second, top), REGIONS, "p2p_sift", P2P_SIFT)
    assert frame_result.correct
    assert frame_result.confidence == 0.6


def test_evaluate_frame_node_on_hand() -> None:
    features_by_name = {"sift": points(ON_OBJECT, ON_TARGET, ON_HAND)}
    top = association(point(ON_HAND), point(ON_TARGET))
    frame_result = evaluate_frame(0, result(features_by_name, top), REGIONS, "p2p_sift", P2P_SIFT)
    assert (frame_result.feasible, frame_result.correct, frame_result.hits_hand) == (True, False, True)


def test_evaluate_frame_node_on_hand_near_object() -> None:
    features_by_name = {"sift": points(NEAR_OBJECT, ON_TARGET)}
    top = association(point(NEAR_OBJECT), point(ON_TARGET))
    frame_result = evaluate_frame(0, result(features_by_name, top), REGIONS, "p2p_sift", P2P_SIFT)
    assert (frame_result.feasible, frame_result.correct, frame_result.hits_hand) == (True, True, True)


def test_evaluate_frame_without_association() -> None:
    frame_result = evaluate_frame(3, result({"sift": points(ON_OBJECT)}), REGIONS, "p2p_sift", P2P_SIFT)
    assert frame_result == FrameResult(3, False, False, False, False, 0.0, 1.0)


def test_evaluate_frame_rsw_is_not_negative() -> None:
    features_by_name = {"sift": points(ON_OBJECT, ON_TARGET, ON_HAND)}
    pair = (point(ON_OBJECT), point(ON_TARGET))
    top, second = association(*pair, confidence=0.9), association(*pair, rank=2, confidence=0.1000001)
    assert evaluate_frame(0, result(features_by_name, top, second), REGIONS, "p2p_sift", P2P_SIFT).rsw == 0.0


def test_evaluate_frame_of_each_member() -> None:
    features_by_name = {
        "sift": points(ON_OBJECT, ON_HAND),
        "orb": points(ON_OBJECT, ON_TARGET),
        "lbd": lines(ON_TARGET),
    }
    listed = (
        association(point(ON_OBJECT), point(ON_HAND), confidence=0.9),
        association(point(ON_OBJECT), point(ON_TARGET), confidence=0.4, member="p2p_orb"),
        association(point(ON_HAND), line(ON_TARGET), confidence=0.7, member="p2l_sift_lbd"),
    )
    members = {
        "p2p_sift": P2P_SIFT,
        "p2p_orb": member(PointToPoint(), "orb"),
        "p2l_sift_lbd": member(PointToLine(), "sift", "lbd"),
    }
    sift, orb, mixed = (
        evaluate_frame(0, result(features_by_name, *listed), REGIONS, *item) for item in members.items()
    )
    assert (sift.feasible, sift.correct, sift.hits_hand, sift.confidence) == (False, False, True, 0.9)
    assert (orb.feasible, orb.correct, orb.hits_hand, orb.confidence) == (True, True, False, 0.4)
    assert (mixed.feasible, mixed.correct, mixed.hits_hand, mixed.confidence) == (True, False, True, 0.7)


@pytest.mark.parametrize(
    ("kernel", "extractors", "message"),
    [
        (PointToPoint(), ["orb"], "no features of 'orb' in the result; expected one of \\['lbd', 'sift'\\]"),
        (PointToLine(), ["lbd", "sift"], "'lbd' yields line features; expected point for p2l"),
    ],
)
def test_evaluate_frame_refuses_result_of_other_members(kernel: Kernel, extractors: list[str], message: str) -> None:
    features_by_name = {"sift": points(ON_OBJECT), "lbd": lines(ON_TARGET)}
    with pytest.raises(ValueError, match=message):
        evaluate_frame(0, result(features_by_name), REGIONS, "member", member(kernel, *extractors))


@pytest.mark.parametrize(
    ("on_points", "on_lines", "feasible"),
    [
        ([ON_OBJECT], [ON_TARGET], True),
        ([ON_TARGET], [ON_OBJECT], True),
        ([ON_OBJECT, ON_TARGET], [ON_OBJECT], True),
        ([ON_OBJECT], [ON_OBJECT], False),
        ([ON_OBJECT, ON_TARGET], [], False),
        ([ON_OBJECT, ON_TARGET], [ON_HAND], False),
        ([], [ON_OBJECT, ON_TARGET], False),
    ],
)
def test_is_feasible_p2l(
    on_points: list[tuple[float, float]], on_lines: list[tuple[float, float]], feasible: bool
) -> None:
    features_by_name = {NodeType.POINT: points(*on_points), NodeType.LINE: lines(*on_lines)}
    assert is_feasible(PointToLine(), features_by_name, REGIONS) is feasible


PLACES = st.lists(st.sampled_from([ON_OBJECT, ON_TARGET, ON_HAND, ON_NOTHING]), max_size=4)


@given(on_points=PLACES, on_lines=PLACES)
def test_is_feasible_means_some_instance_is_right(
    on_points: list[tuple[float, float]], on_lines: list[tuple[float, float]]
) -> None:
    features_by_name = {NodeType.POINT: points(*on_points), NodeType.LINE: lines(*on_lines)}
    point_nodes, line_nodes = [point(xy) for xy in on_points], [line(xy) for xy in on_lines]
    instances: list[tuple[Kernel, list[tuple[Node, Node]]]] = [
        (PointToPoint(), list(combinations(point_nodes, 2))),
        (LineToLine(), list(combinations(line_nodes, 2))),
        (PointToLine(), list(product(point_nodes, line_nodes))),
    ]
    for kernel, pairs in instances:
        expected = any(joins_object_and_target(nodes, REGIONS) for nodes in pairs)
        assert is_feasible(kernel, features_by_name, REGIONS) is expected


def test_summarize_four_frames() -> None:
    frame_results = [
        FrameResult(0, True, True, True, False, 0.8, 0.1, 9.0, GoalResult(0.002, True)),
        FrameResult(1, True, True, False, True, 0.6, 0.2, 7.0, GoalResult(None, True)),
        # Infeasible: its hand hit counts, its error does not.
        FrameResult(2, True, False, False, True, 0.4, 0.3, 5.0, GoalResult(None, False)),
        FrameResult(3, False, True, False, False, 0.0, 1.0),
    ]
    metrics = summarize(frame_results, SwitchCount(switches=1, comparable=2))
    assert metrics == {
        "frames": 4,
        "feasible_frames": 3,
        "infeasible_frames": 1,
        "frames_without_association": 1,
        "top1_accuracy": pytest.approx(1 / 3),
        "strictly_feasible_frames": 2,
        "strict_accuracy": 0.5,
        "goal_error_mm": pytest.approx(2.0),
        "hand_rate": 0.5,
        "mean_confidence": pytest.approx(0.45),
        "precision": pytest.approx(1 / 3),
        "expected_calibration_error": pytest.approx((0.2 + 0.6 + 0.4) / 3),
        "reliability": [
            *[[0, 0.0, 0.0]] * 4,
            [1, 0.4, 0.0],
            [0, 0.0, 0.0],
            [1, 0.6, 0.0],
            [0, 0.0, 0.0],
            [1, 0.8, 1.0],
            [0, 0.0, 0.0],
        ],
        "rsw": pytest.approx(0.4),
        "switches": 1,
        "comparable_transitions": 2,
        "switches_per_frame": 0.5,
        "error_autocorrelation": None,  # of two pairs
    }


def test_summarize_without_anything_to_average() -> None:
    metrics = summarize([FrameResult(0, True, False, False, False, 0.5, 0.0)], SwitchCount(0, 0))
    assert metrics["top1_accuracy"] is None
    assert metrics["switches_per_frame"] is None
    assert json.loads(json.dumps(metrics, allow_nan=False)) == metrics
    assert summarize([], SwitchCount(0, 0))["mean_confidence"] is None


def test_summarize_ensemble() -> None:
    right = summarize([FrameResult(0, True, True, True, False, 0.8, 0.0)], SwitchCount(0, 1))
    wrong = summarize([FrameResult(0, True, True, False, True, 0.2, 0.5)], SwitchCount(1, 1))
    infeasible = summarize([FrameResult(0, True, False, False, False, 0.5, 0.1)], SwitchCount(0, 0))
    metrics = summarize_ensemble({"a": right, "b": wrong, "c": infeasible})
    assert metrics["top1_accuracy"] == 0.5
    assert metrics["switches_per_frame"] == 0.5
    assert metrics["hand_rate"] == pytest.approx(1 / 3)
    assert metrics["mean_confidence"] == pytest.approx(0.5)
    assert metrics["rsw"] == pytest.approx(0.2)
    assert (metrics["frames"], metrics["feasible_frames"], metrics["switches"]) == (1, 1, 0)
    assert metrics["members"] == {"a": right, "b": wrong, "c": infeasible}
