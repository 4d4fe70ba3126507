"""What the places of a carried thing tell of features on it, on the background, and on the hand."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
import torch

from geoskill.features.feature_set import FeatureSet
from geoskill.geometry.primitives import NodeType
from geoskill.tracking.known_ends import known_ends, preference_of, trajectory_of, with_known_displacements
from geoskill.tracking.motion import Displacement, Part
from geoskill.tracking.places import Places, find_places
from tests.carrying import BELOW_THE_HAND, FRAMES, NEW_XY, OLD_XY, Carrying, draw, hand_xy

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
        below = hand_xy(t, Carrying()) + 1.7 * BELOW_THE_HAND  # which the hand does not hide
        thing = OLD_XY if t < places().picked else NEW_XY if t >= places().placed else below
        xy = np.array([thing, TABLE_XY, hand_xy(t, Carrying())], np.float32)
        geometry = xy if extent == 1 else np.concatenate([xy - 1, xy + 1], axis=1)
        node_type = NodeType.POINT if extent == 1 else NodeType.LINE
        sets.append(FeatureSet(node_type, descriptors, geometry, np.ones(3, np.float32)))
    return sets


def test_known_ends_at_rest() -> None:
    ends = known_ends(features(), places())
    for frame in (1, FRAMES - 1):
        assert ends[frame].at_rest.tolist() == [True, False, False]
        assert ends[frame].part.tolist() == [Part.THING, Part.BACKGROUND, Part.UNRELATED]
        assert ends[frame].known.tolist() == [True, True, False]
        np.testing.assert_allclose(ends[frame].start[THING], OLD_XY, atol=2.5)
        np.testing.assert_allclose(ends[frame].end[THING], NEW_XY, atol=2.5)
        np.testing.assert_array_equal(ends[frame].end[TABLE], TABLE_XY)


def test_a_feature_where_the_carried_thing_is_seen_moves_with_it() -> None:
    known = known_ends(features(), places())[CARRIED]
    assert known.part.tolist() == [Part.THING, Part.BACKGROUND, Part.UNKNOWN], (
        "the hand at the thing is not known to be"
    )
    assert known.carried.tolist() == [True, False, False]
    assert known.at_rest.tolist() == [False, False, False]
    beside = hand_xy(CARRIED, Carrying()) + 0.7 * BELOW_THE_HAND - features()[CARRIED].geometry[THING]
    np.testing.assert_allclose(known.start[THING] + beside, OLD_XY - BELOW_THE_HAND, atol=8)
    np.testing.assert_allclose(known.end[THING] - known.start[THING], np.subtract(NEW_XY, OLD_XY), atol=2.5)


def hidden() -> Places:
    """Return the places of a thing that is not seen while it is carried."""
    path = places().path
    return replace(places(), path=replace(path, seen=np.zeros_like(path.seen)))


def test_the_carried_thing_that_is_not_seen_is_recognized_by_its_descriptor() -> None:
    known = known_ends(features(), hidden())[CARRIED]
    assert known.part.tolist() == [Part.THING, Part.BACKGROUND, Part.UNRELATED]
    assert not known.at_rest.any()
    assert not known.carried.any()
    np.testing.assert_allclose(known.start[THING], OLD_XY, atol=2.5)
    np.testing.assert_allclose(known.end[THING], NEW_XY, atol=2.5)


def test_a_carried_feature_that_looks_like_something_else_is_unrelated() -> None:
    sets = features()
    mixed = np.float32([[0.6, 0, 0.8, 0, 0, 0, 0, 0], *np.eye(3, 8)[1:]])
    sets[CARRIED] = FeatureSet(NodeType.POINT, mixed, sets[CARRIED].geometry, sets[CARRIED].scores)
    known = known_ends(sets, hidden())[CARRIED]
    assert known.part.tolist() == [Part.UNRELATED, Part.BACKGROUND, Part.UNRELATED]


def test_nothing_is_recognized_without_a_feature_of_the_thing_at_rest() -> None:
    sets = [own.take([TABLE, HAND]) for own in features()]
    sets[CARRIED] = features()[CARRIED]
    assert known_ends(sets, hidden())[CARRIED].known.tolist() == [False, True, False]
    assert len(known_ends([own.take([]) for own in sets], places())) == FRAMES


@pytest.mark.parametrize("extent", [1, 2], ids=["points", "segments"])
def test_trajectory_of_known_ends(extent: int) -> None:
    ends = known_ends(features(extent), places())[0]
    first = trajectory_of(ends, anchors=4)
    assert first.first_known_anchor.tolist() == [0, 0, 4], "nothing is known of the hand"
    assert first.final_known.tolist() == [True, True, False]
    assert first.part.tolist() == [Part.THING, Part.BACKGROUND, Part.UNRELATED]
    np.testing.assert_array_equal(first.anchor_xy.numpy(), np.tile(ends.start[:, None], (1, 4, 1)))
    np.testing.assert_array_equal(first.final_xy[THING].numpy(), ends.end[THING])


def test_a_feature_in_the_seam_of_the_thing_is_unknown() -> None:
    """Its descriptor shows both, and it looks as if it came to the thing that lies next to it in the end."""
    sets = features()
    row = np.flatnonzero(places().new[round(NEW_XY[1])])
    geometry = sets[-1].geometry.copy()
    geometry[HAND] = row.max() + 1, NEW_XY[1]
    sets[-1] = FeatureSet(NodeType.POINT, np.eye(3, 8, dtype=np.float32), geometry, sets[-1].scores)
    assert known_ends(sets, places())[-1].part.tolist() == [Part.THING, Part.BACKGROUND, Part.UNKNOWN]


def test_preference_of_the_thing_and_its_target() -> None:
    """The table's feature is far from the new place; one beside it is the target's."""
    beside = np.float32([[NEW_XY[0] + 20, NEW_XY[1]]])
    candidates = {}
    for frame in (2, FRAMES - 1):
        own = features()[frame]
        geometry = np.concatenate([own.geometry, beside])
        candidates[frame] = FeatureSet(NodeType.POINT, np.eye(4, 8, dtype=np.float32), geometry, np.ones(4, np.float32))
    preference = preference_of(candidates, FRAMES, places())
    assert preference is not None
    thing, target = preference.groups
    assert thing.argmax(axis=1).tolist() == [THING, THING]
    assert target.argmax(axis=1).tolist() == [3, 3]
    assert set(preference.others.argmax(axis=1).tolist()) == {TABLE, HAND}
    assert preference_of({2: candidates[2].take([TABLE, HAND, 3])}, FRAMES, places()) is None


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
    assert carried.tracked.tolist() == [True, True, True], "tracking says where the hand goes"
    np.testing.assert_allclose(carried.next_geometry[THING], sets[CARRIED + 4].geometry[THING], atol=6)
    unseen = with_known_displacements(spans, sets, hidden(), known_ends(sets, hidden()))[CARRIED, 4]
    assert unseen.tracked.tolist() == [False, True, False], "tracking alone says where a carried feature goes"
    assert unseen.next_geometry[THING].tolist() == [-3, -3]
