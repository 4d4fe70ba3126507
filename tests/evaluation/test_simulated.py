"""Tests of simulated labels on hand-made recordings, whose fixtures describe the scenes."""

from collections.abc import Sequence
from dataclasses import replace

import pytest

from geoskill.evaluation.labels import TOLERANCE_PX
from geoskill.evaluation.simulated import SimulatedFrame, SimulatedLabels
from geoskill.simulation.recording import Recording
from geoskill.simulation.roles import SceneRole
from geoskill.simulation.tasks.task import INFINITE, RolePart

OBJECT, TARGET, HAND = SceneRole


def label(
    frame: SimulatedFrame,
    x: float,
    y: float,
    tolerance_px: float = TOLERANCE_PX,
    among: Sequence[SceneRole] = SceneRole,
) -> SceneRole | None:
    return frame.label((float(x), float(y)), float(tolerance_px), tuple(among))


@pytest.mark.parametrize(
    ("point", "expected"),
    [
        ((12, 15), OBJECT),
        ((30, 15), TARGET),
        ((12, 12), HAND),  # next to the object, but it is what the pixel shows
        ((20, 15), None),
        ((40, 15), None),  # nothing
        # The object ends with column 10: 3 px beyond it still count.
        ((9.6, 15), OBJECT),
        ((7, 15), OBJECT),
        ((6.4, 15), None),
        # Diagonally, 2 and 2 px are 2.8, but 3 and 1 are 3.2.
        ((8, 19), OBJECT),
        ((7, 18), None),
        # 1.4 px from the object and 2 px from the finger: the object goes first.
        ((15, 12), OBJECT),
        ((34.2, 20), TARGET),
    ],
)
def test_simulated_label(
    hand_made_recording: Recording, point: tuple[float, float], expected: SceneRole | None
) -> None:
    assert label(SimulatedFrame(hand_made_recording, 0), *point) is expected


def test_simulated_label_with_other_tolerances_and_roles(hand_made_recording: Recording) -> None:
    frame = SimulatedFrame(hand_made_recording, 0)
    assert label(frame, 9, 15, 0) is None
    assert label(frame, 10, 15, 0) is OBJECT
    assert label(frame, 5, 15, 5) is OBJECT
    assert label(frame, 12, 12, among=(OBJECT, TARGET)) is OBJECT  # the finger has no say
    assert label(frame, 15, 12, among=(HAND, OBJECT)) is HAND
    assert label(frame, 12, 15, among=(TARGET, HAND)) is HAND  # 3 px away
    assert label(frame, 12, 15, among=(TARGET,)) is None


@pytest.mark.parametrize(
    ("point", "expected"),
    [
        ((39, 29), HAND),
        ((43, 30), HAND),  # 3 px outside the picture
        ((44, 30), None),
        ((39, 33.4), HAND),
        ((39, 34), None),
        # Pixel -1 would be the last one of a row or a column.
        ((-1, 29), None),
        ((39, -1), None),
        ((-1, -1), None),
        ((1e6, -1e6), None),
    ],
)
def test_simulated_label_at_image_border(
    hand_made_recording: Recording, point: tuple[float, float], expected: SceneRole | None
) -> None:
    assert label(SimulatedFrame(hand_made_recording, 1), *point) is expected


def test_simulated_at_goal(hand_made_recording: Recording) -> None:
    frame = SimulatedFrame(hand_made_recording, 0)
    points = [(14.0, 15.0), (27.0, 12.0), (20.0, 15.0), (12.0, 11.0), (12.0, 13.0)]
    moved = frame.at_goal(points)
    # The box's right edge becomes its far one. The finger's pixel is within 3 px of the box, the table's is not.
    expected = [(30.0, 13.0), (27.0, 12.0), None, (28.0, 15.0), (28.0, 15.0)]
    for point, by_hand in zip(moved, expected, strict=True):
        assert point == (None if by_hand is None else pytest.approx(by_hand))
    assert frame.at_goal([]) == []
    assert frame.goal_pixel_m == pytest.approx(0.01)
    # At the goal, everything is where it is.
    there = SimulatedFrame(hand_made_recording, 1)
    assert there.at_goal([(30.0, 13.0), (33.0, 18.0)]) == [pytest.approx((30, 13)), pytest.approx((33, 18))]


def test_simulated_label_of_part_of_body(hand_made_recording: Recording) -> None:
    # The right part of the box, from its middle column on, is the object; then what is within 1 cm the target.
    parts = (
        RolePart("box", SceneRole.OBJECT, lower=(-0.001, -INFINITE, -INFINITE)),
        RolePart("box", SceneRole.TARGET, (-0.011, -0.011, -INFINITE), (0.011, 0.011, INFINITE)),
    )
    frame = SimulatedFrame(replace(hand_made_recording, roles=parts), 0)
    row = [label(frame, column, 15, 0) for column in range(9, 16)]
    assert row == [None, None, TARGET, OBJECT, OBJECT, OBJECT, None]
    column = [label(frame, 11, row, 0) for row in range(13, 18)]
    assert column == [None, TARGET, TARGET, TARGET, None]
    assert label(frame, 10, 15, 2, among=(OBJECT,)) is OBJECT
    assert label(frame, 30, 15) is None  # the tile has no role now


def test_simulated_frame_of_folded_cloth(folded_cloth: Recording) -> None:
    flat, folded = (SimulatedFrame(folded_cloth, frame) for frame in (0, 1))
    # Column 20 + x / 1.25 cm, row 15 - y / 1.25 cm.
    assert label(flat, 22, 9, 0) is OBJECT
    assert label(flat, 26, 13, 0) is TARGET
    # The same pixel later shows the upper layer, and beside it still the lower one.
    assert label(folded, 26, 13, 0) is OBJECT
    assert label(folded, 27, 13, 0) is TARGET
    # (2.5, 7.5) cm of the cloth come to lie above (7.5, 2.5), 2 cm over the table, 0.98 m from the camera.
    above = (20 + 80 * 0.075 / 0.98, 15 - 80 * 0.025 / 0.98)
    assert flat.at_goal([(22.0, 9.0), (26.0, 13.0)]) == [pytest.approx(above), pytest.approx((26, 13))]
    assert folded.at_goal([(26.0, 13.0)]) == [pytest.approx((26, 13), abs=2e-3)]
    # The vertices are 1 cm over the table on average.
    assert flat.goal_pixel_m == pytest.approx(0.99 / 80)


def test_simulated_labels(hand_made_recording: Recording) -> None:
    labels = SimulatedLabels(hand_made_recording, "made up, robot")
    assert (labels.first_frame, labels.last_frame, labels.name) == (0, 1, "made up, robot")
    assert labels.at(-1) is None
    assert labels.at(2) is None
    first, last = labels.at(0), labels.at(1)
    assert first is not None
    assert last is not None
    assert (label(first, 12, 15), label(last, 12, 15)) == (OBJECT, None)
    labels.require_size((41, 31))
    labels.require_evaluated(2, 1)
    with pytest.raises(ValueError, match=r"made up, robot: the frames are \(31, 41\); expected \(41, 31\)"):
        labels.require_size((31, 41))
