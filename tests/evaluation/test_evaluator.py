"""Tests of whole evaluations with a skill whose answers are known."""

import json
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest

from geoskill.errors import InputError
from geoskill.evaluation.annotations.load import load_regions
from geoskill.evaluation.evaluator import evaluate_frames
from geoskill.evaluation.regions import FrameRegions, Regions
from geoskill.features.feature_set import FeatureSet
from geoskill.geometry.primitives import NodeType
from geoskill.io.frames import Frame
from geoskill.io.sources import open_frames
from geoskill.kernels.kernel import Kernel, node_types
from geoskill.kernels.p2l import PointToLine
from geoskill.kernels.p2p import PointToPoint
from geoskill.model.bilinear import Bilinear
from geoskill.model.kernel_model import KernelModel
from geoskill.model.scorer import Motif
from geoskill.simulation.roles import SceneRole
from geoskill.skill.association import Association, InferenceResult, Node


def member(kernel: Kernel, *extractors: str) -> KernelModel:
    """Return an untrained member with one extractor for each node type."""
    names = dict(zip(node_types(kernel), extractors, strict=True))
    return KernelModel(kernel, names, Bilinear(Motif.of(kernel, dict.fromkeys(names, 1)), hidden_dim=1))


P2P_SIFT = {"p2p_sift": member(PointToPoint(), "sift")}


def rectangle(left: float, top: float, right: float, bottom: float) -> np.ndarray:
    return np.array([[left, top], [right, top], [right, bottom], [left, bottom]], np.float32)


LABELS = FrameRegions(
    {
        SceneRole.OBJECT: rectangle(20, 20, 50, 50),
        SceneRole.TARGET: rectangle(70, 20, 100, 50),
        SceneRole.AGENT: rectangle(20, 60, 50, 90),
    }
)
ON_OBJECT, ELSEWHERE_ON_OBJECT, ON_TARGET, ON_HAND = (30.0, 30.0), (42.0, 42.0), (80.0, 40.0), (30.0, 70.0)


def regions(*labeled: int, image_size: tuple[int, int] = (120, 100)) -> Regions:
    return Regions("labels.json", image_size, dict.fromkeys(labeled, LABELS))


def still_frames(count: int) -> Iterator[Frame]:
    noise = np.random.default_rng(0).uniform(0, 255, (100, 120)).astype(np.float32)
    smooth = np.asarray(cv2.GaussianBlur(noise, (0, 0), 2.0))
    gray = np.interp(smooth, (smooth.min(), smooth.max()), (0, 255)).astype(np.uint8)
    for index in range(count):
        yield Frame(index, index / 30, np.repeat(gray[:, :, None], 3, axis=2))


def point_set(*xy: tuple[float, float]) -> FeatureSet:
    count = len(xy)
    geometry = np.array(xy, np.float32).reshape(-1, 2)
    return FeatureSet(NodeType.POINT, np.ones((count, 1), np.float32), geometry, np.ones(count, np.float32))


def pair(first: tuple[float, float], second: tuple[float, float], confidence: float = 0.75) -> Association:
    nodes = (Node(NodeType.POINT, first), Node(NodeType.POINT, second))
    return Association("p2p_sift", "p2p", "sift", 1, confidence, confidence, nodes, (0.0, 0.0))


def answers(*tops: Association | None) -> Callable[[np.ndarray], InferenceResult]:
    """Return a skill that selects these one after another."""
    features = {"sift": point_set(ON_OBJECT, ELSEWHERE_ON_OBJECT, ON_TARGET, ON_HAND)}
    remaining = iter(tops)

    def infer(image: np.ndarray) -> InferenceResult:
        top = next(remaining)
        return InferenceResult(() if top is None else (top,), features)

    return infer


RIGHT = pair(ON_OBJECT, ON_TARGET)


def test_evaluate_frames_metrics_and_rows() -> None:
    infer = answers(
        RIGHT, pair(ON_TARGET, ON_OBJECT), pair(ELSEWHERE_ON_OBJECT, ON_TARGET), pair(ON_HAND, ON_TARGET, 0.5), None
    )
    metrics, rows = evaluate_frames(still_frames(5), infer, regions(0, 4), P2P_SIFT)
    assert (metrics["frames"], metrics["feasible_frames"], metrics["frames_without_association"]) == (5, 5, 1)
    assert metrics["top1_accuracy"] == pytest.approx(3 / 5)
    assert metrics["hand_rate"] == pytest.approx(1 / 5)
    assert metrics["mean_confidence"] == pytest.approx((3 * 0.75 + 0.5) / 5)
    assert metrics["rsw"] == pytest.approx((3 * 0.25 + 0.5 + 1) / 5)
    assert metrics["switches_per_frame"] == pytest.approx(2 / 3)
    assert metrics["unlabeled_frames"] == 0
    assert list(metrics["members"]) == ["p2p_sift"]
    assert [row["switched"] for row in rows] == [None, False, True, True, None]
    assert [row["correct"] for row in rows] == [True, True, True, False, False]
    assert rows[3] == {
        "frame": 3,
        "kernel": "p2p",
        "descriptor": "sift",
        "has_association": True,
        "feasible": True,
        "correct": False,
        "hits_hand": True,
        "strict": None,  # drawn regions do not know the goal
        "goal_error_mm": None,
        "confidence": 0.5,
        "rsw": 0.5,
        "switched": True,
    }
    for written in (metrics, rows):
        assert json.loads(json.dumps(written, allow_nan=False)) == written


def test_evaluate_frames_skips_unlabeled_frames() -> None:
    metrics, rows = evaluate_frames(still_frames(9), answers(RIGHT, RIGHT, RIGHT), regions(3, 5), P2P_SIFT)
    assert [row["frame"] for row in rows] == [3, 4, 5]
    assert metrics["unlabeled_frames"] == 6


def test_evaluate_frames_every_third_counts_from_start_of_sequence() -> None:
    metrics, rows = evaluate_frames(still_frames(10), answers(RIGHT, RIGHT, RIGHT), regions(2, 9), P2P_SIFT, every=3)
    assert [row["frame"] for row in rows] == [3, 6, 9]
    assert [row["switched"] for row in rows] == [None, False, False]
    assert (metrics["frames"], metrics["comparable_transitions"], metrics["unlabeled_frames"]) == (3, 2, 1)


def test_evaluate_frames_of_ensemble() -> None:
    segments = FeatureSet(
        NodeType.LINE, np.ones((1, 1), np.float32), np.array([[70, 40, 90, 40]], np.float32), np.ones(1, np.float32)
    )
    segment = Node(NodeType.LINE, (70.0, 40.0, 90.0, 40.0))
    mixed = Association(
        "p2l_sift_lbd", "p2l", "sift+lbd", 1, 0.25, 0.25, (Node(NodeType.POINT, ON_HAND), segment), (0.0,)
    )
    features = {"sift": point_set(ON_OBJECT, ON_TARGET, ON_HAND), "lbd": segments}
    outcome = InferenceResult((RIGHT, mixed), features)
    members = P2P_SIFT | {"p2l_sift_lbd": member(PointToLine(), "sift", "lbd")}
    metrics, rows = evaluate_frames(still_frames(2), lambda image: outcome, regions(0, 1), members)
    assert [(row["frame"], row["kernel"], row["correct"]) for row in rows] == [
        (0, "p2p", True),
        (0, "p2l", False),
        (1, "p2p", True),
        (1, "p2l", False),
    ]
    assert metrics["top1_accuracy"] == 0.5
    assert metrics["members"]["p2l_sift_lbd"]["hand_rate"] == 1.0
    assert metrics["members"]["p2p_sift"]["mean_confidence"] == 0.75


def test_evaluate_frames_takes_one_frame_at_a_time() -> None:
    waiting: list[int] = []

    def watched() -> Iterator[Frame]:
        for frame in still_frames(4):
            waiting.append(frame.index)
            yield frame

    seen: list[list[int]] = []

    def infer(image: np.ndarray) -> InferenceResult:
        seen.append(list(waiting))
        return answers(RIGHT)(image)

    shown: list[int] = []

    def progress(frames: Iterable[Frame]) -> Iterator[Frame]:
        for frame in frames:
            shown.append(frame.index)
            yield frame

    evaluate_frames(watched(), infer, regions(0, 3), P2P_SIFT, progress=progress)
    assert seen == [[0], [0, 1], [0, 1, 2], [0, 1, 2, 3]]
    assert shown == [0, 1, 2, 3]


def test_evaluate_frames_refuses_labels_that_do_not_fit() -> None:
    with pytest.raises(InputError, match=r"labels\.json: image_size is 64x64; expected 120x100"):
        evaluate_frames(still_frames(2), answers(RIGHT), regions(0, image_size=(64, 64)), P2P_SIFT)
    with pytest.raises(InputError, match=r"labels\.json: labels frames 7 to 9; .* 5 frames of the video"):
        evaluate_frames(still_frames(5), answers(RIGHT), regions(7, 9), P2P_SIFT)
    with pytest.raises(InputError, match="every=3"):
        evaluate_frames(still_frames(5), answers(RIGHT), regions(1, 2), P2P_SIFT, every=3)


def test_evaluate_frames_refuses_bad_arguments() -> None:
    with pytest.raises(InputError, match="every=0: expected at least 1"):
        evaluate_frames(still_frames(2), answers(RIGHT), regions(0), P2P_SIFT, every=0)
    with pytest.raises(ValueError, match="at least one"):
        evaluate_frames(still_frames(2), answers(RIGHT), regions(0), {})


@pytest.mark.slow
def test_evaluate_frames_with_ground_truth_on_blocks(blocks: Path) -> None:
    ground_truth = load_regions(blocks / "human1.regions.json", (240, 240), 205)
    numbers = iter(range(0, 205, 20))

    def infer(image: np.ndarray) -> InferenceResult:
        at = ground_truth.at(next(numbers))
        assert at is not None
        vertices = {region: tuple(map(float, at.polygons[region][0])) for region in SceneRole}
        on_object, on_target = vertices[SceneRole.OBJECT], vertices[SceneRole.TARGET]
        return InferenceResult(
            (pair((on_object[0], on_object[1]), (on_target[0], on_target[1])),),
            {"sift": point_set((on_object[0], on_object[1]), (on_target[0], on_target[1]))},
        )

    metrics, rows = evaluate_frames(open_frames(blocks / "human1"), infer, ground_truth, P2P_SIFT, every=20)
    assert (metrics["frames"], metrics["feasible_frames"], metrics["top1_accuracy"]) == (11, 11, 1.0)
    assert metrics["hand_rate"] == 0.0
    assert [row["frame"] for row in rows] == list(range(0, 205, 20))
