"""Maps between two pictures through one feature, against known maps."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from geoskill.geometry.anchored_map import MIN_SUPPORT, Matches, anchored_map, mapped, residuals
from geoskill.geometry.primitives import NodeType

POINT, LINE = NodeType.POINT, NodeType.LINE
several_examples = settings(max_examples=8, deadline=None)
TOLERANCE_PX = 3.0


def similarity(degrees: float, scale: float, x: float, y: float) -> np.ndarray:
    c, s = scale * math.cos(math.radians(degrees)), scale * math.sin(math.radians(degrees))
    return np.array([[c, -s, x], [s, c, y], [0.0, 0.0, 1.0]])


def matched(node_type: NodeType, source: np.ndarray, target: np.ndarray, first: int = 0) -> Matches:
    return Matches(node_type, source.astype(float), target.astype(float), np.arange(first, first + len(source)))


def joined(*parts: Matches) -> Matches:
    fields = zip(*((own.source, own.target, own.feature) for own in parts), strict=True)
    return Matches(parts[0].node_type, *(np.concatenate(own) for own in fields))


@several_examples
@given(
    seed=st.integers(0, 10**6),
    degrees=st.floats(-170, 170),
    scale=st.floats(0.6, 1.8),
    shift=st.tuples(st.floats(-80, 80), st.floats(-80, 80)),
)
def test_background_does_not_outvote_the_thing(
    seed: int, degrees: float, scale: float, shift: tuple[float, float]
) -> None:
    random = np.random.default_rng(seed)
    expected = similarity(degrees, scale, *shift)
    thing = random.uniform(100, 180, (12, 2))
    background = random.uniform(0, 640, (60, 2))
    others = joined(
        matched(POINT, thing[1:], mapped(expected, thing[1:])), matched(POINT, background, background, first=20)
    )
    found = anchored_map(matched(POINT, thing[:1], mapped(expected, thing[:1])), others, TOLERANCE_PX)
    assert found is not None
    if np.linalg.norm(mapped(expected, thing) - thing, axis=1).min() > 12:  # told apart from what rests
        np.testing.assert_allclose(mapped(found, thing), mapped(expected, thing), atol=1.5)


def test_wrong_candidates_of_the_anchor_lose() -> None:
    random = np.random.default_rng(1)
    expected = similarity(20, 1.1, 30, -15)
    thing = random.uniform(50, 150, (8, 2))
    target = mapped(expected, thing)
    candidates = Matches(POINT, np.array([[400.0, 20.0], thing[0], thing[3]]), target[[0, 0, 0]], np.zeros(3, int))
    found = anchored_map(candidates, matched(POINT, thing[1:], target[1:], first=1), TOLERANCE_PX)
    assert found is not None
    np.testing.assert_allclose(found, expected, atol=1e-6)


def test_order_of_the_matches_does_not_matter() -> None:
    random = np.random.default_rng(2)
    thing = random.uniform(0, 200, (15, 2))
    target = mapped(similarity(5, 1, 3, 4), thing) + random.normal(0, 0.5, (15, 2))
    anchor, order = matched(POINT, thing[:1], target[:1]), random.permutation(14)
    first = anchored_map(anchor, matched(POINT, thing[1:], target[1:]), TOLERANCE_PX)
    second = anchored_map(anchor, matched(POINT, thing[1:][order], target[1:][order]), TOLERANCE_PX)
    assert first is not None
    assert second is not None
    np.testing.assert_allclose(first, second, atol=1e-8)


@pytest.mark.parametrize(("agreeing", "found"), [(MIN_SUPPORT - 1, False), (MIN_SUPPORT, True)])
def test_too_little_support_gives_nothing(agreeing: int, found: bool) -> None:
    source = np.array([[0.0, 0.0], [40.0, 0.0], [0.0, 40.0], [40.0, 40.0]])[: agreeing + 1]
    target = source + np.array([7.0, 9.0])
    anchor = matched(POINT, source[:1], target[:1])
    assert (anchored_map(anchor, matched(POINT, source[1:], target[1:]), TOLERANCE_PX) is not None) == found


def test_features_at_one_place_count_once() -> None:
    source = np.array([[40.0, 0.0]] * 5)
    anchor = matched(POINT, np.zeros((1, 2)), np.zeros((1, 2)))
    assert anchored_map(anchor, matched(POINT, source, source), TOLERANCE_PX) is None


@pytest.mark.parametrize("node_type", [POINT, LINE])
def test_nothing_to_match_gives_nothing(node_type: NodeType) -> None:
    width = node_type.geometry_dim
    nothing, anchor = np.zeros((0, width)), matched(node_type, np.ones((1, width)), np.ones((1, width)))
    assert anchored_map(anchor, matched(node_type, nothing, nothing), TOLERANCE_PX) is None
    assert anchored_map(matched(node_type, nothing, nothing), anchor, TOLERANCE_PX) is None


@pytest.mark.parametrize("bent", [[0.0, 0.0], [2e-4, -3e-4]], ids=["affine", "homography"])
def test_map_with_more_freedom_where_support_allows(bent: list[float]) -> None:
    random = np.random.default_rng(3)
    expected = np.array([[1.08, 0.05, 4.0], [-0.02, 0.97, 9.0], [*bent, 1.0]])
    thing = random.uniform(0, 60, (30, 2))
    target = mapped(expected, thing)
    found = anchored_map(matched(POINT, thing[:1], target[:1]), matched(POINT, thing[1:], target[1:]), TOLERANCE_PX)
    assert found is not None
    np.testing.assert_allclose(mapped(found, thing), target, atol=0.3)


@several_examples
@given(seed=st.integers(0, 10**6), degrees=st.floats(-60, 60), scale=st.floats(0.8, 1.25))
def test_lines_split_otherwise_give_the_map_of_their_carriers(seed: int, degrees: float, scale: float) -> None:
    random = np.random.default_rng(seed)
    expected = similarity(degrees, scale, 25, -40)
    angles = random.uniform(0, math.pi, 14)
    angles[:4] = np.radians([3, 50, 95, 140])
    middle, half = random.uniform(100, 300, (14, 2)), random.uniform(20, 60, (14, 1))
    along = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    source = np.concatenate([middle - half * along, middle + half * along], axis=1)
    moved = mapped(expected, source)
    direction = moved[:, 2:] - moved[:, :2]
    target = moved + np.concatenate([0.1 * direction, -0.2 * direction], axis=1)  # the detector ends them elsewhere
    found = anchored_map(matched(LINE, source[:1], target[:1]), matched(LINE, source[1:], target[1:], 1), TOLERANCE_PX)
    assert found is not None
    assert residuals(found[None], matched(LINE, source, target)).max() < TOLERANCE_PX


def test_points_around_a_line_give_the_map_that_takes_it_along() -> None:
    random = np.random.default_rng(4)
    expected = similarity(-12, 0.9, 60, 20)
    thing, line = random.uniform(0, 100, (9, 2)), np.array([[0.0, 50.0, 90.0, 60.0]])
    found = anchored_map(
        matched(LINE, line, mapped(expected, line)), matched(POINT, thing, mapped(expected, thing)), TOLERANCE_PX
    )
    assert found is not None
    np.testing.assert_allclose(found, expected, atol=1e-6)


def test_residual_of_another_line_on_the_same_carrier_is_infinite() -> None:
    source = np.array([[0.0, 0.0, 10.0, 0.0], [0.0, 0.0, 10.0, 0.0]])
    target = np.array([[200.0, 0.0, 220.0, 0.0], [4.0, 1.0, 30.0, 1.0]])
    assert residuals(np.eye(3)[None], matched(LINE, source, target)).tolist() == [[math.inf, 1.0]]


def test_mapped_by_hand() -> None:
    quarter = similarity(90, 2, 1, 0)
    np.testing.assert_allclose(mapped(quarter, np.array([[1.0, 0.0, 0.0, 3.0]])), [[1.0, 2.0, -5.0, 0.0]], atol=1e-12)
