"""What is selected stays while its features are there and nothing is better for long. On the frames of the fixture."""

from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path

import cv2
import numpy as np
import pytest

from geoskill import TemporalFilter as PublicSteadySkill
from geoskill.errors import InputError
from geoskill.evaluation.switches import SwitchCounter
from geoskill.skill import temporal_filter
from geoskill.skill.association import Association, InferenceResult
from geoskill.skill.skill import Skill
from geoskill.skill.temporal_filter import TemporalFilter

POINTS = "p2p_sift"


@pytest.fixture
def skill(skill_file: Path) -> Skill:
    return Skill.load(skill_file)


def of_points(result: InferenceResult) -> list[Association]:
    return [association for association in result.associations if association.kernel == "p2p"]


def turn_over(skill: Skill) -> None:
    """What scored most scores least from here on."""
    for member in skill.members.values():
        member.scorer.register_forward_hook(lambda module, given, scores: -scores)


def test_the_package_offers_it() -> None:
    assert PublicSteadySkill is TemporalFilter


def test_the_first_frame_is_judged_by_itself(skill: Skill, demonstration_frames: Sequence[np.ndarray]) -> None:
    frame = demonstration_frames[6]
    alone, first = skill.infer(frame), TemporalFilter(skill).infer(frame)
    assert first.associations == alone.associations
    np.testing.assert_array_equal(first.error, alone.error)


def test_it_switches_less_than_frame_by_frame(skill: Skill, demonstration_frames: Sequence[np.ndarray]) -> None:
    switches = []
    for infer in (skill.infer, TemporalFilter(skill).infer):
        counter = SwitchCounter(skill.members[POINTS].kernel)
        for frame in demonstration_frames:
            counter.advance(frame)
            counter.evaluate(of_points(infer(frame))[0])
        assert counter.count.comparable > 10
        switches.append(counter.count.switches)
    assert switches[1] < switches[0] / 2


def test_what_is_much_worse_goes_at_once(skill: Skill, demonstration_frames: Sequence[np.ndarray]) -> None:
    frame, selector = demonstration_frames[6], TemporalFilter(skill)
    first = selector.infer(frame)
    turn_over(skill)
    assert selector.infer(frame).associations == skill.infer(frame).associations
    assert of_points(skill.infer(frame))[0].nodes != of_points(first)[0].nodes


def test_a_lead_adds_up_until_patience_ends(
    skill: Skill, demonstration_frames: Sequence[np.ndarray], monkeypatch: pytest.MonkeyPatch
) -> None:
    frame, selector = demonstration_frames[6], TemporalFilter(skill)
    kept = of_points(selector.infer(frame))[0]
    turn_over(skill)
    scores = skill.observe(frame).members[POINTS].scores
    monkeypatch.setattr(temporal_filter, "TOLERATED_MARGIN", 0.5)
    lead = float((scores.max() - scores.min()) / scores.std(correction=0)) - 0.5
    monkeypatch.setattr(temporal_filter, "PATIENCE", 2.5 * lead)
    for _ in range(2):
        listed = of_points(selector.infer(frame))
        assert set(listed[0].nodes) == set(kept.nodes)
        assert listed[0].confidence < listed[1].confidence, "the best of the others follow"
        assert [association.rank for association in listed] == [1, 2, 3, 4]
        assert set(listed[1].nodes) == set(of_points(skill.infer(frame))[0].nodes)
    assert of_points(selector.infer(frame)) == of_points(skill.infer(frame))


def test_the_sign_of_the_error_stays(skill: Skill, demonstration_frames: Sequence[np.ndarray]) -> None:
    selector = TemporalFilter(skill)
    errors = [np.array(of_points(selector.infer(frame))[0].error) for frame in demonstration_frames[:4]]
    assert all(np.linalg.norm(later - earlier) < 8 for earlier, later in pairwise(errors))


def keep_weak_features(skill: Skill, selector: TemporalFilter, frame: np.ndarray) -> Association:
    """Has an association kept that joins neither of the two strongest points."""
    skill.alternatives = 1000
    listed = of_points(selector.infer(frame))
    skill.alternatives = 4
    weak = next(a for a in listed if all(node.feature is not None and node.feature >= 2 for node in a.nodes))
    gray = np.asarray(cv2.cvtColor(frame, cv2.COLOR_RGB2GRAY), np.uint8)
    selector._selected[POINTS] = temporal_filter._Selected(weak, temporal_filter._appearance(weak.nodes, gray))
    return weak


def test_what_is_not_detected_is_followed_for_a_while(skill: Skill, demonstration_frames: Sequence[np.ndarray]) -> None:
    frame, selector = demonstration_frames[6], TemporalFilter(skill)
    weak = keep_weak_features(skill, selector, frame)
    skill.pipelines["sift"].max_features = 2
    for _ in range(temporal_filter.MAX_MISSED_FRAMES):
        (found,) = of_points(selector.infer(frame))
        assert (found.rank, found.confidence) == (1, weak.confidence)
        assert [node.feature for node in found.nodes] == [None, None]
        for node, expected in zip(found.nodes, weak.nodes, strict=True):
            np.testing.assert_allclose(node.coordinates, expected.coordinates, atol=0.1)
        np.testing.assert_allclose(found.error, weak.error, atol=0.2)
    (found,) = of_points(selector.infer(frame))
    assert [node.feature for node in found.nodes] in ([0, 1], [1, 0])


def test_the_nodes_of_what_is_not_detected_move_with_the_picture(
    skill: Skill, demonstration_frames: Sequence[np.ndarray]
) -> None:
    frame, selector = demonstration_frames[6], TemporalFilter(skill)
    weak = keep_weak_features(skill, selector, frame)
    skill.pipelines["sift"].max_features = 2
    (found,) = of_points(selector.infer(np.roll(frame, (2, 3), axis=(0, 1))))
    for node, expected in zip(found.nodes, weak.nodes, strict=True):
        np.testing.assert_allclose(node.coordinates, np.add(expected.coordinates, (3, 2)), atol=0.3)


def test_what_is_covered_goes(skill: Skill, demonstration_frames: Sequence[np.ndarray]) -> None:
    frame, selector = demonstration_frames[6], TemporalFilter(skill)
    weak = keep_weak_features(skill, selector, frame)
    skill.pipelines["sift"].max_features = 2
    x, y = (round(value) for value in weak.nodes[0].center)
    covered = frame.copy()
    patch = np.random.default_rng(2).integers(0, 255, (9, 9, 3), np.uint8)
    covered[y - 4 : y + 5, x - 4 : x + 5] = patch
    (found,) = of_points(selector.infer(covered))
    assert None not in [node.feature for node in found.nodes]


@pytest.mark.parametrize("other", ["noise", "smaller", "empty"])
def test_what_is_lost_goes(skill: Skill, demonstration_frames: Sequence[np.ndarray], other: str) -> None:
    selector = TemporalFilter(skill)
    selector.infer(demonstration_frames[6])
    frames = {
        "noise": np.random.default_rng(1).integers(0, 255, (120, 160, 3), np.uint8),
        "smaller": np.ascontiguousarray(demonstration_frames[6][:100]),
        "empty": np.full((120, 160, 3), 77, np.uint8),
    }
    result = selector.infer(frames[other])
    assert result.associations == skill.infer(frames[other]).associations
    assert result.reasons == skill.infer(frames[other]).reasons
    again = selector.infer(demonstration_frames[6])
    assert again.associations == skill.infer(demonstration_frames[6]).associations


def test_two_points_of_what_moves_fall_behind(skill: Skill, demonstration_frames: Sequence[np.ndarray]) -> None:
    skill.alternatives, last = 10000, 16
    selector = TemporalFilter(skill)
    for small in demonstration_frames[: last + 1]:
        frame = np.asarray(cv2.resize(small, None, fx=2, fy=2, interpolation=cv2.INTER_CUBIC), np.uint8)
        result = selector.infer(frame)
    alone = {frozenset(node.feature for node in each.nodes): each for each in of_points(skill.infer(frame))}

    def moved(x: float, y: float) -> bool:
        return 2 * (28 + 2.5 * last) + 8 < x < 2 * (60 + 2.5 * last) - 8 and 100 < y < 148

    def rested(x: float, y: float) -> bool:
        return (x > 2 * 108 + 8 and 100 < y < 148) or y > 2 * 88 + 8

    inside, astride = [], []
    for association in of_points(result):
        one, other = (node.center for node in association.nodes)
        before = alone[frozenset(node.feature for node in association.nodes)]
        change = np.log(association.weight) - np.log(before.weight)
        if moved(*one) and moved(*other):
            inside.append(change)
        elif (moved(*one) and rested(*other)) or (rested(*one) and moved(*other)):
            astride.append(change)
    assert len(inside) > 5
    np.testing.assert_allclose(astride, astride[0], atol=1e-5)
    # Of a tile of a few plain squares, not every point can be followed.
    drawback = temporal_filter.CO_MOTION_PENALTY * float(skill.observe(frame).members[POINTS].scores.std(correction=0))
    fallen = np.isclose(np.array(inside) - astride[0], -drawback, rtol=1e-3)
    assert fallen.sum() > len(inside) / 2


@pytest.mark.usefixtures("annotations_unchecked")
def test_bad_frames_are_refused(skill: Skill) -> None:
    with pytest.raises(InputError, match=r"^the frame is uint8 \[5, 6\]; expected uint8 \[height, width, 3\], RGB$"):
        TemporalFilter(skill).infer(np.zeros((5, 6), np.uint8))
