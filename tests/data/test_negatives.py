"""Negatives: their source pictures, and frames to which they are added."""

from collections.abc import Callable
from typing import Any

import cv2
import numpy as np
import pytest
import torch

from geoskill.data.dead_leaves import dead_leaves
from geoskill.data.demonstration import Demonstration
from geoskill.data.negatives import TRANSFORMS, append_negatives, synthesize_negatives
from geoskill.features.feature_set import FeatureSet
from geoskill.features.pipeline import FeaturePipeline
from geoskill.features.sift import Sift
from geoskill.geometry.primitives import NodeType
from geoskill.tracking.motion import Displacement, Part, Trajectory
from geoskill.tuning import NegativesConfig

# A `Training` is what the fixtures of conftest.py make; see there.
Training = Any


@pytest.mark.slow
def test_negatives_come_from_transformed_frames_and_dead_leaves(demonstration_frames: tuple[np.ndarray, ...]) -> None:
    frames, pipeline = demonstration_frames[:3], FeaturePipeline(Sift(), max_features=20, min_side=0)
    reports = []

    def progress(items: Any, text: str) -> Any:
        reports.append((list(items), text))
        return items

    negatives = synthesize_negatives(frames, pipeline, progress)
    assert reports == [([0, 1, 2], "finding negatives")]
    assert negatives.node_type is NodeType.POINT
    mirrored = pipeline.extract(np.ascontiguousarray(frames[1][:, ::-1]))
    negative = pipeline.extract(255 - frames[1])
    known = {row.tobytes() for row in negatives.descriptors}
    assert {row.tobytes() for row in mirrored.descriptors} | {row.tobytes() for row in negative.descriptors} <= known
    of_transformed_frames = len(frames) * len(TRANSFORMS) * 20
    assert len(negatives) > of_transformed_frames + len(frames) * NegativesConfig().leaves_per_frame * 10, (
        "and of leaves, at most 20 from each picture"
    )
    assert np.array_equal(synthesize_negatives(frames, pipeline, progress).descriptors, negatives.descriptors)


@pytest.mark.slow
@pytest.mark.parametrize(("source_frames", "leaves_per_frame"), [(1, 0), (2, 1), (3, 0)])
def test_negatives_come_from_as_many_pictures_as_configured(
    demonstration_frames: tuple[np.ndarray, ...], source_frames: int, leaves_per_frame: int
) -> None:
    pipeline, reports = FeaturePipeline(Sift(), max_features=20, min_side=0), []
    default = synthesize_negatives(demonstration_frames[:5], pipeline, lambda items, text: items)

    def progress(items: Any, text: str) -> Any:
        reports.append(list(items))
        return items

    config = NegativesConfig(source_frames, leaves_per_frame)
    negatives = synthesize_negatives(demonstration_frames[:5], pipeline, progress, config=config)
    assert reports == [{1: [0], 2: [0, 4], 3: [0, 2, 4]}[source_frames]]
    pictures = source_frames * (len(TRANSFORMS) + leaves_per_frame)
    assert 10 * pictures < len(negatives) <= 20 * pictures
    known = {row.tobytes() for row in default.descriptors}
    transformed = negatives.descriptors[: len(TRANSFORMS) * 20]
    assert {row.tobytes() for row in transformed} <= known


@pytest.mark.parametrize("seed", [0, 1])
def test_dead_leaves_cover_the_picture(seed: int) -> None:
    picture = dead_leaves(120, 160, np.random.default_rng(seed))
    assert picture.shape == (120, 160, 3)
    assert picture.dtype == np.uint8
    halves = [*np.split(picture, 2, axis=0), *np.split(picture, 2, axis=1)]
    assert all(half.std() > 30 for half in halves)
    assert len(Sift().extract(cv2.cvtColor(picture, cv2.COLOR_RGB2GRAY))) > 40
    colorful = cv2.blur(picture, (3, 3)).astype(int).max(axis=2) - cv2.blur(picture, (3, 3)).astype(int).min(axis=2)
    assert (colorful < 25).mean() > 0.1 < (colorful > 60).mean(), "some are gray, some are not"
    assert not np.array_equal(picture, dead_leaves(120, 160, np.random.default_rng(seed + 1)))


@pytest.mark.parametrize("own", [3, 0])
def test_append_negatives_are_last_and_untracked(own: int) -> None:
    random = np.random.default_rng(0)

    def features(count: int) -> FeatureSet:
        descriptors = random.normal(size=(count, 4)).astype(np.float32)
        descriptors /= np.linalg.norm(descriptors, axis=1, keepdims=True)
        strength = np.arange(count, 0, -1, dtype=np.float32)
        return FeatureSet(NodeType.POINT, descriptors, random.uniform(size=(count, 2)).astype(np.float32), strength)

    own_features, negatives = features(own), features(2)
    all_true = torch.ones(own, dtype=torch.bool)
    motion = Displacement(torch.rand(own, 2), all_true)
    trajectory = Trajectory(
        torch.rand(own, 5, 2),
        torch.zeros(own, dtype=torch.long),
        torch.rand(own, 2),
        all_true,
        torch.full((own,), Part.THING),
    )
    joined, moved, traveled = append_negatives(own_features, motion, trajectory, negatives)
    assert np.array_equal(joined.descriptors, np.concatenate([own_features.descriptors, negatives.descriptors]))
    assert np.array_equal(joined.geometry, np.concatenate([own_features.geometry, negatives.geometry]))
    assert moved.tracked.tolist() == traveled.final_known.tolist() == [True] * own + [False] * 2
    others = Part.UNRELATED if own else Part.UNKNOWN
    assert traveled.part.tolist() == [Part.THING] * own + [others] * 2, "negatives have no part in a task that is known"
    assert traveled.first_known_anchor.tolist() == [0] * own + [5] * 2, "a negative is known at no anchor"
    for joined_values, own_values in (
        (moved.next_geometry, motion.next_geometry),
        (traveled.final_xy, trajectory.final_xy),
        (traveled.anchor_xy[:, 3], trajectory.anchor_xy[:, 3]),
    ):
        assert torch.equal(joined_values, torch.cat([own_values, torch.from_numpy(negatives.geometry)]))


@pytest.mark.slow
def test_demonstration_samples_negatives_per_frame(
    training_of: Callable[..., Training], demonstration_frames: tuple[np.ndarray, ...]
) -> None:
    training = training_of("p2p_sift")
    members = training.members()
    plain = training.demonstration

    def with_negatives(count: int) -> Demonstration:
        return Demonstration(
            demonstration_frames,
            training.pipelines,
            members,
            gap=2,
            max_span_ratio=0.6,
            num_negatives=count,
            progress=lambda items, text: items,
        )

    augmented = with_negatives(7)
    added = []
    for index in (0, 1, 40):
        original, joined = plain[index]["p2p_sift"]["first"], augmented[index]["p2p_sift"]["first"]
        count = original.node_count(NodeType.POINT)
        assert torch.equal(joined.point_descriptor[:count], original.point_descriptor)
        assert joined.node_count(NodeType.POINT) == count + 7
        assert joined.point_count.tolist() == [count + 7]
        added.append(joined.point_descriptor[count:])
        assert torch.equal(
            augmented.graph_without_negatives("p2p_sift", index).point_descriptor, original.point_descriptor
        )
    assert not torch.equal(added[0], added[1])
    repeated = augmented[0]["p2p_sift"]["first"]
    assert torch.equal(repeated.point_descriptor[-7:], added[0]), "the same in every epoch, so that training can resume"
