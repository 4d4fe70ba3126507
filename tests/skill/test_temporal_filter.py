"""Tests of the temporal filter on the frames of the fixture."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import cv2
import numpy as np
import pytest

from geoskill import TemporalFilter as PublicTemporalFilter
from geoskill.errors import InputError
from geoskill.evaluation.switches import SwitchCounter
from geoskill.skill import temporal_filter
from geoskill.skill.association import Association, Goal, InferenceResult
from geoskill.skill.skill import Skill
from geoskill.skill.temporal_filter import TemporalFilter
from geoskill.tuning import CoMotionConfig, TemporalFilterConfig

POINTS = "p2p_sift"


@pytest.fixture
def skill(skill_file: Path) -> Skill:
    return Skill.load(skill_file)


def of_points(result: InferenceResult) -> list[Association]:
    return [association for association in result.associations if association.kernel == "p2p"]


def negate_scores(skill: Skill) -> None:
    """Make the members give the best instance the lowest score, and the other way round."""
    for member in skill.members.values():
        member.scorer.register_forward_hook(lambda module, given, scores: -scores)


def test_temporal_filter_is_exported() -> None:
    assert PublicTemporalFilter is TemporalFilter


def test_temporal_filter_on_first_frame_equals_skill(skill: Skill, demonstration_frames: Sequence[np.ndarray]) -> None:
    frame = demonstration_frames[6]
    alone, first = skill.infer(frame), TemporalFilter(skill).infer(frame)
    assert first.associations == alone.associations
    np.testing.assert_array_equal(first.error, alone.error)


@pytest.mark.slow
def test_temporal_filter_switches_less_than_skill(skill: Skill, demonstration_frames: Sequence[np.ndarray]) -> None:
    switches = []
    for infer in (skill.infer, TemporalFilter(skill).infer):
        counter = SwitchCounter(skill.members[POINTS].kernel)
        for frame in demonstration_frames:
            counter.advance(frame)
            counter.evaluate(of_points(infer(frame))[0])
        assert counter.count.comparable > 10
        switches.append(counter.count.switches)
    assert switches[1] < switches[0] / 2


def test_temporal_filter_drops_much_worse_association_at_once(
    skill: Skill, demonstration_frames: Sequence[np.ndarray]
) -> None:
    frame, selector = demonstration_frames[6], TemporalFilter(skill)
    first = selector.infer(frame)
    negate_scores(skill)
    assert selector.infer(frame).associations == skill.infer(frame).associations
    assert of_points(skill.infer(frame))[0].nodes != of_points(first)[0].nodes


def test_temporal_filter_switches_after_patience(skill: Skill, demonstration_frames: Sequence[np.ndarray]) -> None:
    frame = demonstration_frames[6]
    scores = skill.observe(frame).members[POINTS].scores
    excess = float((scores.max() - scores.min()) / scores.std(correction=0)) - 0.5  # once they are negated
    selector = TemporalFilter(skill, TemporalFilterConfig(tolerated_margin=0.5, patience=2.5 * excess))
    first = of_points(selector.infer(frame))[0]
    negate_scores(skill)
    for _ in range(2):
        listed = of_points(selector.infer(frame))
        assert set(listed[0].nodes) == set(first.nodes)
        assert listed[0].confidence < listed[1].confidence, "the kept one is first whatever its confidence"
        assert [association.rank for association in listed] == [1, 2, 3, 4]
        assert set(listed[1].nodes) == set(of_points(skill.infer(frame))[0].nodes)
    assert of_points(selector.infer(frame)) == of_points(skill.infer(frame))


def test_temporal_filter_keeps_sign_of_error(skill: Skill, demonstration_frames: Sequence[np.ndarray]) -> None:
    selector = TemporalFilter(skill)
    errors = [np.array(of_points(selector.infer(frame))[0].error) for frame in demonstration_frames[:4]]
    assert all(np.linalg.norm(later - earlier) < 8 for earlier, later in pairwise(errors))


def keep_weak_features(skill: Skill, selector: TemporalFilter, frame: np.ndarray) -> Association:
    """Select an association that joins neither of the two strongest points, and return it."""
    skill.spec = replace(skill.spec, top_k=1000)
    listed = of_points(selector.infer(frame))
    skill.spec = replace(skill.spec, top_k=4)
    weak = next(a for a in listed if all(node.feature is not None and node.feature >= 2 for node in a.nodes))
    gray = np.asarray(cv2.cvtColor(frame, cv2.COLOR_RGB2GRAY), np.uint8)
    selector._selected[POINTS] = temporal_filter._Selected(weak, temporal_filter._appearance(weak.nodes, gray))
    return weak


@pytest.mark.parametrize("config", [None, TemporalFilterConfig(max_missed_frames=1)], ids=["default", "1"])
def test_temporal_filter_tracks_undetected_nodes_for_max_missed_frames(
    skill: Skill, demonstration_frames: Sequence[np.ndarray], config: TemporalFilterConfig | None
) -> None:
    frame, selector = demonstration_frames[6], TemporalFilter(skill, config)
    weak = keep_weak_features(skill, selector, frame)
    skill.pipelines["sift"].max_features = 2
    for _ in range((config or TemporalFilterConfig()).max_missed_frames):
        (kept,) = of_points(selector.infer(frame))
        assert (kept.rank, kept.confidence) == (1, weak.confidence)
        assert [node.feature for node in kept.nodes] == [None, None]
        for node, expected in zip(kept.nodes, weak.nodes, strict=True):
            np.testing.assert_allclose(node.coordinates, expected.coordinates, atol=0.1)
        np.testing.assert_allclose(kept.error, weak.error, atol=0.2)
    (kept,) = of_points(selector.infer(frame))
    assert [node.feature for node in kept.nodes] in ([0, 1], [1, 0])


def test_temporal_filter_moves_undetected_nodes_with_the_image(
    skill: Skill, demonstration_frames: Sequence[np.ndarray]
) -> None:
    frame, selector = demonstration_frames[6], TemporalFilter(skill)
    weak = keep_weak_features(skill, selector, frame)
    skill.pipelines["sift"].max_features = 2
    (kept,) = of_points(selector.infer(np.roll(frame, (2, 3), axis=(0, 1))))
    for node, expected in zip(kept.nodes, weak.nodes, strict=True):
        np.testing.assert_allclose(node.coordinates, np.add(expected.coordinates, (3, 2)), atol=0.3)


def test_temporal_filter_drops_occluded_association(skill: Skill, demonstration_frames: Sequence[np.ndarray]) -> None:
    frame, selector = demonstration_frames[6], TemporalFilter(skill)
    weak = keep_weak_features(skill, selector, frame)
    skill.pipelines["sift"].max_features = 2
    x, y = (round(value) for value in weak.nodes[0].center)
    covered = frame.copy()
    patch = np.random.default_rng(2).integers(0, 255, (9, 9, 3), np.uint8)
    covered[y - 4 : y + 5, x - 4 : x + 5] = patch
    (kept,) = of_points(selector.infer(covered))
    assert None not in [node.feature for node in kept.nodes]


def test_temporal_filter_prefers_what_is_at_its_goal_after_what_was(
    skill: Skill, demonstration_frames: Sequence[np.ndarray]
) -> None:
    first, second, third = of_points(skill.infer(demonstration_frames[6]))[:3]
    done = replace(second, goal=Goal(((1.0, 2.0), None), (0.5, 0.5), (0.7, 0.7), tolerance=3.0))
    far = replace(third, goal=Goal(((1.0, 2.0), None), (9.0, 0.5), (0.7, 0.7), tolerance=3.0))
    last = [temporal_filter._Selected(own, ()) for own in (far, done)]
    assert temporal_filter._first_selected([first, far, done], last[0]) is first
    assert temporal_filter._first_selected([first, far, done], last[1]) is done
    assert temporal_filter._first_selected([first, far], last[1]) is first
    assert temporal_filter._first_selected([first, done], None) is first


@pytest.mark.parametrize("content", ["noise", "smaller", "empty"])
def test_temporal_filter_drops_lost_association(
    skill: Skill, demonstration_frames: Sequence[np.ndarray], content: str
) -> None:
    selector = TemporalFilter(skill)
    selector.infer(demonstration_frames[6])
    frames = {
        "noise": np.random.default_rng(1).integers(0, 255, (120, 160, 3), np.uint8),
        "smaller": np.ascontiguousarray(demonstration_frames[6][:100]),
        "empty": np.full((120, 160, 3), 77, np.uint8),
    }
    result = selector.infer(frames[content])
    assert result.associations == skill.infer(frames[content]).associations
    assert result.reasons == skill.infer(frames[content]).reasons
    again = selector.infer(demonstration_frames[6])
    assert again.associations == skill.infer(demonstration_frames[6]).associations


@pytest.mark.slow
def test_temporal_filter_passes_co_motion_settings_on(skill: Skill, demonstration_frames: Sequence[np.ndarray]) -> None:
    """Where no displacement is large enough, nothing is in co-motion, and the penalty changes nothing."""
    config = TemporalFilterConfig(co_motion=CoMotionConfig(min_displacement_ratio=10.0), co_motion_penalty=100.0)
    default, without = TemporalFilter(skill), TemporalFilter(skill, config)
    unpenalized = TemporalFilter(skill, TemporalFilterConfig(co_motion_penalty=0.0))
    for small in demonstration_frames[:17]:
        frame = np.asarray(cv2.resize(small, None, fx=2, fy=2, interpolation=cv2.INTER_CUBIC), np.uint8)
        expected = unpenalized.infer(frame).associations
        assert without.infer(frame).associations == expected
        last = default.infer(frame).associations
    assert [association.weight for association in last] != [association.weight for association in expected]


@pytest.mark.slow
@pytest.mark.parametrize("config", [None, TemporalFilterConfig(co_motion_penalty=1.0)], ids=["default", "1"])
def test_temporal_filter_penalizes_co_moving_nodes(
    skill: Skill, demonstration_frames: Sequence[np.ndarray], config: TemporalFilterConfig | None
) -> None:
    skill.spec, last = replace(skill.spec, top_k=10000), 16
    selector = TemporalFilter(skill, config)
    for small in demonstration_frames[: last + 1]:
        frame = np.asarray(cv2.resize(small, None, fx=2, fy=2, interpolation=cv2.INTER_CUBIC), np.uint8)
        result = selector.infer(frame)
    alone = {
        frozenset(node.feature for node in association.nodes): association
        for association in of_points(skill.infer(frame))
    }

    def moved(x: float, y: float) -> bool:
        return 2 * (28 + 2.5 * last) + 8 < x < 2 * (60 + 2.5 * last) - 8 and 100 < y < 148

    def rested(x: float, y: float) -> bool:
        return (x > 2 * 108 + 8 and 100 < y < 148) or y > 2 * 88 + 8

    co_moving, separate = [], []
    for association in of_points(result):
        first, second = (node.center for node in association.nodes)
        before = alone[frozenset(node.feature for node in association.nodes)]
        change = np.log(association.weight) - np.log(before.weight)
        if moved(*first) and moved(*second):
            co_moving.append(change)
        elif (moved(*first) and rested(*second)) or (rested(*first) and moved(*second)):
            separate.append(change)
    assert len(co_moving) > 5
    np.testing.assert_allclose(separate, separate[0], atol=1e-5)
    # Not every point of a tile of a few plain squares can be tracked.
    score_std = float(skill.observe(frame).members[POINTS].scores.std(correction=0))
    penalty = (config or TemporalFilterConfig()).co_motion_penalty * score_std
    penalized = np.isclose(np.array(co_moving) - separate[0], -penalty, rtol=1e-3)
    assert penalized.sum() > len(co_moving) / 2


@pytest.mark.usefixtures("annotations_unchecked")
def test_temporal_filter_refuses_bad_frames(skill: Skill) -> None:
    with pytest.raises(InputError, match=r"^the frame is uint8 \[5, 6\]; expected uint8 \[height, width, 3\], RGB$"):
        TemporalFilter(skill).infer(np.zeros((5, 6), np.uint8))
