"""Ground truth at pixels; the fixtures document the scene."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from geoskill.simulation.ground_truth import (
    FrameGroundTruth,
    SurfacePoint,
    goal_pixel_m,
    goal_pixels,
    rest_positions,
    role_of,
)
from geoskill.simulation.recording import Cloth, Recording
from geoskill.simulation.roles import SceneRole


def test_frame_ground_truth_of_known_pixels(hand_made_recording: Recording) -> None:
    pixels = [(14, 13), (20, 15), (27, 12), (40, 0), (-1, 5), (41, 5), (5, 31), (11, 9)]
    points = FrameGroundTruth(hand_made_recording, 0).at(np.array(pixels))
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
    assert len(points) == len(expected)
    for point, known in zip(points, expected, strict=True):
        if known is None:
            assert point is None
            continue
        assert point is not None
        assert (point.body, point.role) == known[:2]
        np.testing.assert_allclose(point.position, known[2], atol=1e-6)


def test_goal_pixels_follow_a_body(hand_made_recording: Recording) -> None:
    (before,) = FrameGroundTruth(hand_made_recording, 0).at(np.array([[14, 13]]))
    assert before is not None
    # The quarter turn takes the box's far right corner to the far left.
    np.testing.assert_allclose(goal_pixels(hand_made_recording, [before]), [[28, 13]], atol=1e-4)
    (after,) = FrameGroundTruth(hand_made_recording, 1).at(np.array([[28, 13]]))
    assert after is not None
    np.testing.assert_allclose(after.position, before.position, atol=1e-6)


def test_ground_truth_of_no_pixels_and_no_points(hand_made_recording: Recording) -> None:
    assert FrameGroundTruth(hand_made_recording, 0).at(np.zeros((0, 2), np.int64)) == []
    assert goal_pixels(hand_made_recording, []).shape == (0, 2)


def test_goal_pixel_width(hand_made_recording: Recording, folded_cloth: Recording) -> None:
    assert goal_pixel_m(hand_made_recording) == pytest.approx(0.8 / 80)
    assert goal_pixel_m(folded_cloth) == pytest.approx((1 - 0.04 / 4) / 80)


def test_role_is_that_of_the_first_part_with_the_point(folded_cloth: Recording) -> None:
    assert role_of(folded_cloth, "cloth", np.array([0.02, 0.06, 0.0])) is SceneRole.OBJECT
    assert role_of(folded_cloth, "cloth", np.array([0.02, 0.05, 0.0])) is SceneRole.OBJECT  # on its border
    assert role_of(folded_cloth, "cloth", np.array([0.02, 0.04, 0.0])) is SceneRole.TARGET
    assert role_of(folded_cloth, "world", np.array([0.02, 0.06, 0.0])) is None


def cloth_of(recording: Recording) -> Cloth:
    assert recording.cloth is not None
    return recording.cloth


def test_rest_positions_of_both_layers_of_a_folded_cloth(folded_cloth: Recording) -> None:
    # With weights of 1/4, 1/4 and 1/2 for the near left, the far right and the lifted corner, a point is 2 cm up. Its
    # mirror image lies below.
    above, below = np.array([[0.075, 0.025, 0.02], [0.075, 0.025, 0.0]])
    positions = rest_positions(cloth_of(folded_cloth), 1, np.stack([above, below, above + np.array([0, 0, 0.002])]))
    np.testing.assert_allclose(positions[:2], [[0.025, 0.075, 0], [0.075, 0.025, 0]], atol=1e-12)
    np.testing.assert_allclose(positions[2], positions[0], atol=1e-3)  # a depth with a small error


@given(st.integers(0, 1), st.floats(0, 1), st.floats(0, 1))
def test_rest_positions_and_goal_pixels_of_random_cloth_points(
    folded_cloth: Recording, triangle: int, u: float, v: float
) -> None:
    if u + v > 1:
        u, v = 1 - u, 1 - v
    weights = np.array([1 - u - v, u, v])
    cloth = cloth_of(folded_cloth)
    corners = cloth.triangles[triangle]
    in_world = weights @ cloth.vertices[1][corners]
    np.testing.assert_allclose(
        rest_positions(cloth, 1, in_world[None]), (weights @ cloth.rest[corners])[None], atol=1e-9
    )
    pixels = goal_pixels(folded_cloth, [SurfacePoint("cloth", None, weights @ cloth.rest[corners])])
    expected = [20 + 80 * in_world[0] / (1 - in_world[2]), 15 - 80 * in_world[1] / (1 - in_world[2])]
    np.testing.assert_allclose(pixels, [expected], atol=1e-6)
