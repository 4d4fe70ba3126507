"""What the places of a carried thing tell of features on it, on the background, and on the hand."""

from functools import cache

import numpy as np
import pytest
import torch

from geoskill.features.feature_set import FeatureSet
from geoskill.geometry.primitives import NodeType
from geoskill.tracking.known_ends import known_ends, with_known_displacements, with_known_trajectories
from geoskill.tracking.motion import Displacement, Trajectory
from geoskill.tracking.places import Places, find_places
from tests.carrying import FRAMES, NEW_XY, OLD_XY, Carrying, draw, hand_xy

THING, TABLE, HAND = 0, 1, 2
CARRIED = 28
TABLE_XY = (15.0, 60.0)


@cache
def places() -> Places:
    found = find_places(draw(Carrying()))
    assert found is not None
    return found


def features(extent: int = 1) -> list[FeatureSet]:
    """Return in every frame one feature on the thing, one on the table, and one on the hand."""
    descriptors = np.eye(3, 8, dtype=np.float32)
    sets = []
    for t in range(FRAMES):
        thing = OLD_XY if t < places().picked else NEW_XY if t >= places().placed else (75, 45)
        xy = np.array([thing, TABLE_XY, hand_xy(t, Carrying())], np.float32)
        geometry = xy if extent == 1 else np.concatenate([xy - 1, xy + 1], axis=1)
        node_type = NodeType.POINT if extent == 1 else NodeType.LINE
        sets.append(FeatureSet(node_type, descriptors, geometry, np.ones(3, np.float32)))
    return sets


def test_known_ends_at_rest() -> None:
    ends = known_ends(features(), places())
    for frame in (1, FRAMES - 1):
        assert ends[frame].at_rest.tolist() == [True, False, False]
        assert ends[frame].background.tolist() == [False, True, False]
        assert ends[frame].known.tolist() == [True, True, False]
        np.testing.assert_allclose(ends[frame].start[THING], OLD_XY, atol=2.5)
        np.testing.assert_allclose(ends[frame].end[THING], NEW_XY, atol=2.5)
        np.testing.assert_array_equal(ends[frame].end[TABLE], TABLE_XY)


def test_the_carried_thing_is_recognized_by_its_descriptor() -> None:
    known = known_ends(features(), places())[CARRIED]
    assert known.known.tolist() == [True, True, False]
    assert known.unrelated.tolist() == [False, False, True]
    assert known.at_rest.tolist() == [False, False, False]
    np.testing.assert_allclose(known.start[THING], OLD_XY, atol=2.5)
    np.testing.assert_allclose(known.end[THING], NEW_XY, atol=2.5)


def test_a_carried_feature_that_looks_like_something_else_is_unrelated() -> None:
    sets = features()
    mixed = np.float32([[0.6, 0, 0.8, 0, 0, 0, 0, 0], *np.eye(3, 8)[1:]])
    sets[CARRIED] = FeatureSet(NodeType.POINT, mixed, sets[CARRIED].geometry, sets[CARRIED].scores)
    known = known_ends(sets, places())[CARRIED]
    assert known.known.tolist() == [False, True, False]
    assert known.unrelated.tolist() == [True, False, True]


def test_nothing_is_recognized_without_a_feature_of_the_thing_at_rest() -> None:
    sets = [own.take([TABLE, HAND]) for own in features()]
    sets[CARRIED] = features()[CARRIED]
    assert known_ends(sets, places())[CARRIED].known.tolist() == [False, True, False]
    assert len(known_ends([own.take([]) for own in sets], places())) == FRAMES


@pytest.mark.parametrize("extent", [1, 2], ids=["points", "segments"])
def test_trajectories_take_the_known_ends(extent: int) -> None:
    sets = features(extent)
    tracked = [
        Trajectory(
            torch.full((3, 4, own.geometry.shape[1]), -1.0),
            torch.tensor([3, 4, 2]),
            torch.full(own.geometry.shape, -2.0),
            torch.tensor([False, False, True]),
            torch.zeros(3, dtype=torch.bool),
        )
        for own in sets
    ]
    ends = known_ends(sets, places())
    corrected = with_known_trajectories(tracked, ends)
    first = corrected[0]
    assert first.first_known_anchor.tolist() == [0, 0, 2]
    assert first.final_known.tolist() == [True, True, False], "what is unrelated has no known end"
    assert first.unrelated.tolist() == [False, False, True]
    np.testing.assert_array_equal(first.anchor_xy[THING].numpy(), np.tile(ends[0].start[THING], (4, 1)))
    np.testing.assert_array_equal(first.final_xy[THING].numpy(), ends[0].end[THING])
    np.testing.assert_array_equal(first.anchor_xy[HAND].numpy(), -np.ones((4, sets[0].geometry.shape[1])))


def test_displacements_take_the_known_places() -> None:
    sets = features()
    lost = Displacement(torch.full((3, 2), -3.0), torch.tensor([False, False, True]))
    spans = {(2, 4): lost, (2, 50): lost, (55, -50): lost, (CARRIED, 4): lost}
    corrected = with_known_displacements(spans, sets, places(), known_ends(sets, places()))
    assert corrected.keys() == spans.keys()
    for frame, span, expected in ((2, 4, OLD_XY), (2, 50, NEW_XY), (55, -50, OLD_XY)):
        moved = corrected[frame, span]
        assert moved.tracked.tolist() == [True, True, False]
        np.testing.assert_allclose(moved.next_geometry[THING], expected, atol=2.5)
        np.testing.assert_array_equal(moved.next_geometry[TABLE], TABLE_XY)
        np.testing.assert_array_equal(moved.next_geometry[HAND], sets[frame].geometry[HAND])
    carried = corrected[CARRIED, 4]
    assert carried.tracked.tolist() == [False, True, False], "tracking alone says where a carried feature goes"
    assert carried.next_geometry[THING].tolist() == [-3, -3]
