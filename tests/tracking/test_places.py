"""The places of a thing that a drawn hand carries over a drawn table, and demonstrations that have none."""

from dataclasses import replace
from functools import cache

import cv2
import numpy as np
import pytest

from geoskill.tracking import places as module
from geoskill.tracking.places import Places, find_places, is_in
from tests.carrying import BELOW_THE_HAND, FRAMES, NEW_XY, OLD_XY, PUTS, TAKES, Carrying, draw, hand_xy, region

LYING = Carrying()


@cache
def found(carrying: Carrying) -> Places | None:
    return find_places(draw(carrying))


def places_of(carrying: Carrying) -> Places:
    places = found(carrying)
    assert places is not None
    return places


def overlap(first: np.ndarray, second: np.ndarray) -> float:
    """Return the intersection over the union of two masks."""
    return float((first & second).sum() / (first | second).sum())


@pytest.mark.parametrize(
    "carrying",
    [LYING, Carrying(turned=60), Carrying(gain=0.9), Carrying(half_size=(16, 18), turned=30)],
    ids=["carried", "turned", "darker", "large"],
)
def test_both_places_are_found(carrying: Carrying) -> None:
    places = places_of(carrying)
    assert overlap(places.old, region(OLD_XY, carrying)) > 0.75
    assert overlap(places.new, region(NEW_XY, carrying, carrying.turned)) > 0.75
    assert places.picked == pytest.approx(TAKES, abs=3)
    assert places.placed == pytest.approx(PUTS, abs=3)
    assert module.MIN_SCORE < places.score <= 1


@pytest.mark.parametrize(
    "carrying",
    [Carrying(put=False), Carrying(taken=False, put=False)],
    ids=["held until the end", "held all the time"],
)
def test_a_thing_that_is_not_put_down_has_no_places(carrying: Carrying) -> None:
    assert found(carrying) is None


def test_pictures_without_change_have_no_places() -> None:
    assert find_places(draw(LYING)[:3]) is None
    assert find_places([draw(LYING)[0]] * 10) is None


def test_the_thing_is_aligned_by_its_print() -> None:
    """Its four corners are where the turned thing has them."""
    carrying = Carrying(turned=60)
    corners = np.array([[-9, -11], [9, -11], [9, 11], [-9, 11]], np.float32)
    angle = np.radians(60)
    turned = corners @ np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]]) + NEW_XY
    moved = places_of(carrying).moved(0, 59, corners + np.array(OLD_XY, np.float32))
    np.testing.assert_allclose(moved, turned, atol=2.5)


def test_a_plain_thing_is_aligned_by_its_center(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "MATCH_RATIO", 0.0)
    places = places_of(LYING)
    shift = find_places(draw(LYING))
    assert shift is not None
    np.testing.assert_allclose(shift.to_new[:, :2], np.eye(2))
    np.testing.assert_allclose(shift.to_new[:, 2], np.subtract(NEW_XY, OLD_XY), atol=2.5)
    assert overlap(shift.old, places.old) == 1


def test_moved_goes_there_and_back() -> None:
    places = places_of(Carrying(turned=60))
    segments = np.array([[30, 80, 40, 90]], np.float32)
    there = places.moved(3, 50, segments)
    assert there is not None
    back = places.moved(50, 3, there)
    np.testing.assert_allclose(back, segments, atol=1e-4)
    np.testing.assert_array_equal(places.moved(3, 9, segments), segments)


def test_moved_follows_the_carried_thing_where_it_is_seen() -> None:
    places = places_of(LYING)
    points = np.array([[30, 80]], np.float32)
    for frame, other in ((3, 28), (28, 32), (28, 57)):
        shift = hand_xy(other, LYING) - hand_xy(frame, LYING)
        if frame == 3:
            shift = hand_xy(other, LYING) + BELOW_THE_HAND - OLD_XY
        elif other == 57:
            shift = NEW_XY - hand_xy(frame, LYING) - BELOW_THE_HAND
        np.testing.assert_allclose(places.moved(frame, other, points), points + shift, atol=8)
    hidden = replace(places, path=replace(places.path, seen=np.zeros_like(places.path.seen)))
    assert hidden.moved(3, 28, points) is None
    assert hidden.carried_region(28) is None


def test_the_carried_region_is_where_the_thing_is() -> None:
    places = places_of(LYING)
    assert places.carried_region(3) is None
    region_there = places.carried_region(28)
    assert region_there is not None
    seen, near = region_there
    thing = hand_xy(28, LYING)[None].astype(np.float32) + np.float32([0, 10])
    assert is_in(seen, thing).all()
    assert not (seen & ~near).any()
    assert not is_in(near, np.array([OLD_XY, NEW_XY], np.float32)).any()


def test_places_of_a_trembling_camera() -> None:
    """Known ends are in pixels of the first frame, whatever the camera does."""
    random = np.random.default_rng(0)
    shifts = np.concatenate([np.zeros((1, 2)), random.integers(-3, 4, (FRAMES - 1, 2))])
    carrying = replace(LYING, person=False)
    pictures = [
        cv2.warpAffine(
            picture, np.column_stack([np.eye(2), shift]), picture.shape[1::-1], borderMode=cv2.BORDER_REPLICATE
        )
        for picture, shift in zip(draw(carrying), shifts, strict=True)
    ]
    places = find_places(pictures)
    assert places is not None
    assert overlap(places.old, region(OLD_XY, carrying)) > 0.7
    assert overlap(places.new, region(NEW_XY, carrying)) > 0.7
    shaken = np.float32([OLD_XY]) + np.float32(shifts[5])
    np.testing.assert_allclose(places.camera.to_first(5, shaken), [OLD_XY], atol=0.5)


def test_resting_tells_the_thing_from_the_background() -> None:
    places = places_of(LYING)
    on_table = np.array([[15, 60]], np.float32)
    old, new = np.array([OLD_XY], np.float32), np.array([NEW_XY], np.float32)
    for frame, on_thing, elsewhere in ((2, old, new), (57, new, old)):
        thing, background = places.resting(frame)
        assert thing is not None
        assert is_in(thing, on_thing).all()
        assert not is_in(thing, elsewhere).any()
        assert is_in(background, on_table).all()
        assert is_in(background, elsewhere).all(), "where it will be put, or was taken from, is background"
        assert not is_in(background & places.seam(frame), on_table).any()
    thing, background = places.resting((TAKES + PUTS) // 2)
    assert thing is None
    assert is_in(background, np.concatenate([old, on_table])).all()


def test_the_hand_is_neither_thing_nor_background() -> None:
    places = places_of(LYING)
    hand = hand_xy(TAKES - 2, LYING)[None].astype(np.float32)
    thing, background = places.resting(TAKES - 2)
    assert not is_in(background, hand).any()
    assert thing is None or not is_in(thing, hand).any()


def test_is_in_leaves_out_what_is_beyond_the_picture() -> None:
    mask = np.ones((10, 20), bool)
    points = np.array([[0, 0], [19, 9], [20, 5], [5, 10], [-1, 5]], np.float32)
    assert is_in(mask, points).tolist() == [True, True, False, False, False]
    assert is_in(mask, np.zeros((0, 4), np.float32)).tolist() == []


def test_scores_fall_with_the_difference_in_color() -> None:
    """The same regions, one of them repainted: less alike, so a lower score."""
    places = places_of(LYING)
    blue = np.where(places.new[..., None], np.float32([40, 20, -60]), places.steps.after)
    steps = replace(places.steps, after=blue)
    old, new = (
        module.ChangedRegion(mask.astype(np.uint8), step, 1.0) for mask, step in ((places.old, 20), (places.new, 36))
    )
    assert module._pair_score(places.steps, old, new) > 2 * module._pair_score(steps, old, new)
    assert module._pair_score(places.steps, new, old) == 0, "it is put down after it was taken"
