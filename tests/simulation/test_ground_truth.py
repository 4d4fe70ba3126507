"""What lies at a pixel; the fixtures say what is where."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from geoskill.simulation.ground_truth import FrameGroundTruth, SurfacePoint, goal_pixel_m, goal_pixels, rest_positions, role_of
from geoskill.simulation.recording import Cloth, Recording
from geoskill.simulation.roles import SceneRole


def test_bodies_roles_and_places_by_hand(hand_made_recording: Recording) -> None:
    pixels = [(14, 13), (20, 15), (27, 12), (40, 0), (-1, 5), (41, 5), (5, 31), (11, 9)]
    found = FrameGroundTruth(hand_made_recording, 0).surface(np.array(pixels))
    # On the box a pixel is 1 cm wide, on the tile and the table 1.25 cm, on the finger 0.75 / 80 m; up is y.
    expected = [
        ("box", SceneRole.OBJECT, (0.02, 0.02, 0)),
        ("table", None, (0, 0, 0)),
        ("tile", SceneRole.TARGET, (-3 * 0.0125, 3 * 0.0125, 0)),
        None,
        None,
        None,
        None,
        ("finger", SceneRole.AGENT, (-9 * 0.009375, 6 * 0.009375, 0)),
    ]
    assert len(found) == len(expected)
    for point, by_hand in zip(found, expected, strict=True):
        if by_hand is None:
            assert point is None
            continue
        assert point is not None
        assert (point.body, point.role) == by_hand[:2]
        np.testing.assert_allclose(point.place, by_hand[2], atol=1e-6)


def test_the_same_point_of_a_body_is_found_where_it_has_gone(hand_made_recording: Recording) -> None:
    (before,) = FrameGroundTruth(hand_made_recording, 0).surface(np.array([[14, 13]]))
    assert before is not None
    # The box's far right corner becomes its far left one.
    np.testing.assert_allclose(goal_pixels(hand_made_recording, [before]), [[28, 13]], atol=1e-4)
    (after,) = FrameGroundTruth(hand_made_recording, 1).surface(np.array([[28, 13]]))
    assert after is not None
    np.testing.assert_allclose(after.place, before.place, atol=1e-6)


def test_no_pixels_and_no_points(hand_made_recording: Recording) -> None:
    assert FrameGroundTruth(hand_made_recording, 0).surface(np.zeros((0, 2), np.int64)) == []
    assert goal_pixels(hand_made_recording, []).shape == (0, 2)


def test_the_width_of_a_pixel_at_the_goal(hand_made_recording: Recording, folded_cloth: Recording) -> None:
    assert goal_pixel_m(hand_made_recording) == pytest.approx(0.8 / 80)
    assert goal_pixel_m(folded_cloth) == pytest.approx((1 - 0.04 / 4) / 80)


def test_the_first_part_that_contains_a_point_decides(folded_cloth: Recording) -> None:
    assert role_of(folded_cloth, "cloth", np.array([0.02, 0.06, 0.0])) is SceneRole.OBJECT
    assert role_of(folded_cloth, "cloth", np.array([0.02, 0.05, 0.0])) is SceneRole.OBJECT  # on its border
    assert role_of(folded_cloth, "cloth", np.array([0.02, 0.04, 0.0])) is SceneRole.TARGET
    assert role_of(folded_cloth, "world", np.array([0.02, 0.06, 0.0])) is None


def cloth_of(recording: Recording) -> Cloth:
    assert recording.cloth is not None
    return recording.cloth


def test_both_layers_of_a_folded_cloth_by_hand(folded_cloth: Recording) -> None:
    # A quarter of the way each to the near left and the far right corner, half to the lifted one, is 2 cm up. Below it
    # lies the mirror image.
    above, below = np.array([[0.075, 0.025, 0.02], [0.075, 0.025, 0.0]])
    found = rest_positions(cloth_of(folded_cloth), 1, np.stack([above, below, above + np.array([0, 0, 0.002])]))
    np.testing.assert_allclose(found[:2], [[0.025, 0.075, 0], [0.075, 0.025, 0]], atol=1e-12)
    np.testing.assert_allclose(found[2], found[0], atol=1e-3)  # a depth that is not quite right


@given(st.integers(0, 1), st.floats(0, 1), st.floats(0, 1))
def test_points_of_a_cloth_keep_their_rest_places(
    folded_cloth: Recording, triangle: int, along: float, across: float
) -> None:
    if along + across > 1:
        along, across = 1 - along, 1 - across
    weights = np.array([1 - along - across, along, across])
    cloth = cloth_of(folded_cloth)
    corners = cloth.triangles[triangle]
    there = weights @ cloth.vertices[1][corners]
    np.testing.assert_allclose(rest_positions(cloth, 1, there[None]), (weights @ cloth.rest[corners])[None], atol=1e-9)
    back = goal_pixels(folded_cloth, [SurfacePoint("cloth", None, weights @ cloth.rest[corners])])
    expected = [20 + 80 * there[0] / (1 - there[2]), 15 - 80 * there[1] / (1 - there[2])]
    np.testing.assert_allclose(back, [expected], atol=1e-6)
