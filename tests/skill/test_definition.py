"""Tests of the task definition, computed by hand."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import yaml

from geoskill.control.settling import Settling
from geoskill.features.feature_set import FeatureSet
from geoskill.geometry.primitives import NodeType
from geoskill.kernels.kernel import Kernel
from geoskill.kernels.p2l import PointToLine
from geoskill.kernels.p2p import PointToPoint
from geoskill.model.bilinear import Bilinear
from geoskill.model.kernel_model import KernelModel
from geoskill.model.scorer import Motif
from geoskill.skill.association import Association, InferenceResult, Node
from geoskill.skill.definition import MAX_CROPPED, MAX_LISTED, TaskDefinition
from geoskill.skill.pin import MIN_SIMILARITY, decoded_descriptor

POINT, LINE = NodeType.POINT, NodeType.LINE
EXTRACTORS = {POINT: "sift", LINE: "lbd"}
# Unit descriptors; the first two are views of one feature, the others are unrelated.
CUP, CUP_AGAIN, SHELF, HAND = (
    np.array(numbers, np.float32) for numbers in ([1, 0, 0, 0], [0.8, 0.6, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1])
)


def member_of(kernel: Kernel) -> KernelModel:
    extractors = {kind: EXTRACTORS[kind] for kind in dict.fromkeys(kernel.roles)}
    return KernelModel(kernel, extractors, Bilinear(Motif.of(kernel, dict.fromkeys(extractors, 4)), hidden_dim=2))


def features_of(node_type: NodeType, descriptors: list[np.ndarray]) -> FeatureSet:
    count, width = len(descriptors), node_type.geometry_dim
    return FeatureSet(
        node_type,
        np.array(descriptors, np.float32).reshape(count, 4),
        np.arange(count * width, dtype=np.float32).reshape(count, width),
        np.zeros(count, np.float32),
    )


def frame_with(first: np.ndarray, second: np.ndarray, confidence: float, error: tuple[float, float]) -> InferenceResult:
    """Return a result whose top association joins rows 1 and 2, and one of rank 2 rows 0 and 2."""
    features = features_of(POINT, [HAND, first, second])

    def node(row: int) -> Node:
        return Node(POINT, tuple(features.geometry[row].tolist()), row)

    return InferenceResult(
        (
            Association("p2p_sift", "p2p", "sift", 1, confidence, confidence, (node(1), node(2)), error),
            Association("p2p_sift", "p2p", "sift", 2, confidence / 2, 0.0, (node(0), node(2)), (99.0, 99.0)),
        ),
        {"sift": features},
    )


NOTHING = InferenceResult((), {"sift": features_of(POINT, [])}, {"p2p_sift": "no instance"})


def definition_of(results: list[InferenceResult], kernels: dict[str, Kernel] | None = None) -> dict[str, Any]:
    kernels = kernels or {"p2p_sift": PointToPoint()}
    definition = TaskDefinition({name: member_of(kernel) for name, kernel in kernels.items()})
    for number, result in enumerate(results):
        definition.add(10 * number, result)
    return definition.as_dict()


def test_definition_of_five_frames() -> None:
    described = definition_of(
        [
            frame_with(CUP, SHELF, 0.5, (3.0, 4.0)),
            frame_with(CUP_AGAIN, SHELF, 0.75, (0.0, 4.0)),
            NOTHING,
            frame_with(HAND, SHELF, 0.25, (0.0, 2.0)),
            frame_with(SHELF, CUP, 0.7, (1.0, 0.0)),
        ]
    )
    assert described["degrees_of_freedom"] == 2
    assert described["task"] == "A thing is moved until one point comes onto another."
    assert described["members"]["p2p_sift"] == {
        "sentence": "One point comes onto another: 2 points, how near is not known; 55 % sure; left free: turns about"
        " the point.",
        "kernel": "p2p",
        "meaning": PointToPoint.meaning,
        "descriptor": "sift",
        "error_rows": ["p2p_sift.x", "p2p_sift.y"],
        "unit": "px",
        "learned": None,
        "goal_tolerance": None,
        "pin": None,
        "constrains": 2,
        "frames": 5,
        "frames_with_association": 4,
        "mean_confidence": 0.55,
        "error_norm": {"at_start": 5.0, "at_end": 1.0},
        "associations": [
            {
                "number": 1,
                "share": 0.6,
                "mean_confidence": 0.65,
                "seen_best_in_frame": 10,
                "nodes": [{"type": "point", "xy": [2.0, 3.0]}, {"type": "point", "xy": [4.0, 5.0]}],
            },
            {
                "number": 2,
                "share": 0.2,
                "mean_confidence": 0.25,
                "seen_best_in_frame": 30,
                "nodes": [{"type": "point", "xy": [2.0, 3.0]}, {"type": "point", "xy": [4.0, 5.0]}],
            },
        ],
    }


def test_definition_counts_undetected_association_in_its_group() -> None:
    """Frames 10 and 30 keep the association of frame 0 although one of its nodes is not detected."""
    seen = frame_with(CUP, SHELF, 0.5, (3.0, 4.0))
    first, second = seen.associations[0].nodes
    kept = replace(seen.associations[0], nodes=(first, Node(POINT, (70.0, 80.0))), error=(0.0, 1.0), confidence=0.5)
    missed = InferenceResult((kept,), seen.features)
    described = definition_of([seen, missed, frame_with(HAND, SHELF, 0.25, (0.0, 2.0)), missed])
    entry = described["members"]["p2p_sift"]
    assert entry["frames_with_association"] == 4
    assert [(group["share"], group["mean_confidence"]) for group in entry["associations"]] == [(0.5, 0.5), (0.5, 0.375)]
    assert entry["associations"][0]["nodes"] == [first.as_json(), second.as_json()]


@pytest.mark.parametrize(("similarity", "groups"), [(MIN_SIMILARITY + 0.01, 1), (MIN_SIMILARITY - 0.01, 2)])
def test_definition_groups_by_min_similarity(similarity: float, groups: int) -> None:
    view = np.array([similarity, np.sqrt(1 - similarity**2), 0, 0], np.float32)
    described = definition_of([frame_with(CUP, SHELF, 0.5, (1.0, 0.0)), frame_with(view, SHELF, 0.5, (1.0, 0.0))])
    assert len(described["members"]["p2p_sift"]["associations"]) == groups


def test_definition_groups_by_least_similar_feature() -> None:
    described = definition_of([frame_with(CUP, SHELF, 0.5, (1.0, 0.0)), frame_with(CUP, HAND, 0.5, (1.0, 0.0))])
    assert [group["share"] for group in described["members"]["p2p_sift"]["associations"]] == [0.5, 0.5]


@pytest.mark.parametrize("order", [(0, 60), (60, 0)])
def test_definition_joins_most_similar_group(order: tuple[int, int]) -> None:
    """Two descriptors 60 degrees apart, and a third 20 degrees from one and 40 from the other."""

    def turned(angle_deg: float) -> np.ndarray:
        angle = np.radians(angle_deg)
        return np.array([np.cos(angle), np.sin(angle), 0, 0], np.float32)

    results = [frame_with(turned(angle), SHELF, 0.9, (1.0, 0.0)) for angle in (*order, 20)]
    associations = definition_of(results)["members"]["p2p_sift"]["associations"]
    expected = 10 * order.index(0)
    assert [(group["share"], group["seen_best_in_frame"]) for group in associations] == [
        (0.6667, expected),
        (0.3333, 10 - expected),
    ]


@pytest.mark.parametrize("frames", [30, 39])
def test_definition_error_norm_is_median_of_a_tenth(frames: int) -> None:
    """The first three frames have errors of 9, 1 and 5 pixels, the last three of 2, 8 and 3."""
    sizes = [9, 1, 5, *[100] * (frames - 6), 2, 8, 3]
    described = definition_of([frame_with(CUP, SHELF, 0.5, (0.0, float(size))) for size in sizes])
    assert described["members"]["p2p_sift"]["error_norm"] == {"at_start": 5.0, "at_end": 3.0}


def test_definition_lists_most_frequent_groups() -> None:
    """There are seven associations, the n-th one in n frames."""
    others = np.eye(8, dtype=np.float32)[1:]
    results = []
    for number, descriptor in enumerate(others, start=1):
        features = FeatureSet(
            POINT,
            np.stack([np.eye(8, dtype=np.float32)[0], descriptor]),
            np.zeros((2, 2), np.float32),
            np.zeros(2, np.float32),
        )
        nodes = (Node(POINT, (0.0, 0.0), 0), Node(POINT, (0.0, 0.0), 1))
        association = Association("p2p_sift", "p2p", "sift", 1, 0.5, 0.5, nodes, (1.0, 0.0))
        results += number * [InferenceResult((association,), {"sift": features})]
    described = definition_of(results)
    shares = [group["share"] for group in described["members"]["p2p_sift"]["associations"]]
    assert shares == [round(count / 28, 4) for count in (7, 6, 5, 4, 3)]
    assert len(shares) == MAX_LISTED


def test_definition_of_ensemble_sums_degrees_of_freedom() -> None:
    points, lines = features_of(POINT, [CUP, SHELF]), features_of(LINE, [HAND])
    result = InferenceResult(
        (
            Association(
                "p2p_sift",
                "p2p",
                "sift",
                1,
                0.5,
                0.5,
                (Node(POINT, (0.0, 1.0), 0), Node(POINT, (2.0, 3.0), 1)),
                (3.0, 4.0),
            ),
            Association(
                "p2l_sift_lbd",
                "p2l",
                "sift+lbd",
                1,
                0.25,
                0.25,
                (Node(POINT, (2.0, 3.0), 1), Node(LINE, (0.0, 1.0, 2.0, 3.0), 0)),
                (-7.0,),
            ),
        ),
        {"sift": points, "lbd": lines},
    )
    described = definition_of([result, result], {"p2p_sift": PointToPoint(), "p2l_sift_lbd": PointToLine()})
    assert described["degrees_of_freedom"] == 3
    mixed = described["members"]["p2l_sift_lbd"]
    assert (mixed["constrains"], mixed["frames"], mixed["mean_confidence"]) == (1, 2, 0.25)
    assert mixed["error_norm"] == {"at_start": 7.0, "at_end": 7.0}
    assert mixed["descriptor"] == "sift+lbd"
    assert [group["share"] for group in mixed["associations"]] == [1.0]
    assert mixed["associations"][0]["nodes"][1] == {"type": "line", "xy": [[0.0, 1.0], [2.0, 3.0]]}


@pytest.mark.parametrize("frames", [0, 3])
def test_definition_without_associations(frames: int) -> None:
    assert definition_of([NOTHING] * frames) == {
        "task": "A thing is moved until one point comes onto another.",
        "degrees_of_freedom": 0,
        "descriptors": {"p2p_sift": []},
        "phases": [],
        "members": {
            "p2p_sift": {
                "sentence": "One point comes onto another: 2 points, how near is not known; not seen in this video;"
                " left free: turns about the point.",
                "kernel": "p2p",
                "meaning": PointToPoint.meaning,
                "descriptor": "sift",
                "error_rows": ["p2p_sift.x", "p2p_sift.y"],
                "unit": "px",
                "learned": None,
                "goal_tolerance": None,
                "pin": None,
                "constrains": 0,
                "frames": frames,
                "frames_with_association": 0,
                "mean_confidence": None,
                "error_norm": {"at_start": None, "at_end": None},
                "associations": [],
            }
        },
    }


def test_definition_lists_descriptors_of_its_associations() -> None:
    described = definition_of([frame_with(CUP, SHELF, 0.5, (3.0, 4.0)), frame_with(HAND, SHELF, 0.25, (0.0, 2.0))])
    listed = [[decoded_descriptor(text, 4) for text in own] for own in described["descriptors"]["p2p_sift"]]
    np.testing.assert_allclose(listed, [[CUP, SHELF], [HAND, SHELF]], atol=1 / 127)


def test_definition_has_crops_of_the_best_frame() -> None:
    """Frame 10 is more sure than frame 0; a frame without a picture leaves the crops as they are."""
    definition = TaskDefinition({"p2p_sift": member_of(PointToPoint())})
    pictures = [np.full((40, 60, 3), level, np.uint8) for level in (10, 20)]
    for number, (confidence, picture) in enumerate(zip((0.5, 0.75, 0.9), (*pictures, None), strict=True)):
        definition.add(10 * number, frame_with(CUP, SHELF, confidence, (1.0, 0.0)), picture)
    (first, second) = definition.pictures()
    assert [first[0], second[0]] == [f"definition/p2p_sift-1-node{node}.png" for node in (1, 2)]
    assert [crop.image.shape for _, crop, _ in (first, second)] == [(10, 10, 3)] * 2
    assert (first[1].image == 20).all()
    nodes = definition.as_dict()["members"]["p2p_sift"]["associations"][0]["nodes"]
    assert [node["picture"] for node in nodes] == [first[0], second[0]]


def test_definition_forgets_crops_of_rare_associations() -> None:
    definition = TaskDefinition({"p2p_sift": member_of(PointToPoint())})
    picture = np.zeros((40, 60, 3), np.uint8)
    for number in range(MAX_CROPPED + 5):
        angle = number * 0.8
        own = np.array([np.cos(angle), np.sin(angle), 0, 0], np.float32)
        other = np.array([0, 0, np.cos(number // 8 * 0.8), np.sin(number // 8 * 0.8)], np.float32)
        definition.add(number, frame_with(own, other, 0.5, (1.0, 0.0)), picture)
    assert len(list(definition.pictures())) <= 2 * MAX_LISTED
    history = definition._history["p2p_sift"]
    assert sum(bool(group.crops) for group in history.groups) <= MAX_CROPPED


def test_definition_round_trips_through_yaml() -> None:
    described = definition_of([frame_with(CUP, SHELF, 1 / 3, (1 / 3, 2 / 3)), NOTHING])
    assert yaml.safe_load(yaml.safe_dump(described)) == described


def test_the_sentence_tells_the_phases_in_their_order() -> None:
    """The point settles after the line; which settles when is not known of a member without a share."""
    members = {"p2p_sift": member_of(PointToPoint()), "p2l_sift_lbd": member_of(PointToLine())}
    members["p2p_sift"].set_settling(Settling(0.8, 3.0, 1.0))
    members["p2l_sift_lbd"].set_settling(Settling(0.6, 3.0, 1.0))
    sentence = TaskDefinition(members).as_dict()["task"]
    line, point = PointToLine.meaning, PointToPoint.meaning
    assert sentence == f"A thing is moved until {line}, and then until {point}."
    unknown = {"p2p_sift": member_of(PointToPoint()), "p2l_sift_lbd": members["p2l_sift_lbd"]}
    assert TaskDefinition(unknown).as_dict()["task"] == sentence, "it comes last"
