"""Which features of a frame are kept: those that look like what the task is about, and the strongest."""

import numpy as np
import pytest

from geoskill.features.feature_set import FeatureSet
from geoskill.features.pipeline import FeaturePipeline
from geoskill.features.preference import MAX_GROUP, MAX_OTHERS, FeaturePreference, merged, thinned
from geoskill.features.sift import Sift
from geoskill.geometry.primitives import NodeType

THING, TARGET, SHIRT = np.eye(3, 4, dtype=np.float32)
PREFERENCE = FeaturePreference((THING[None], TARGET[None]), SHIRT[None])


def features(*descriptors: np.ndarray) -> FeatureSet:
    count = len(descriptors)
    rows = np.array(descriptors, np.float32).reshape(count, 4)
    return FeatureSet(NodeType.POINT, rows, np.zeros((count, 2), np.float32), np.arange(count, 0, -1, dtype=np.float32))


def test_choose_keeps_a_quarter_for_each_group_and_the_strongest() -> None:
    found = features(*[SHIRT] * 6, THING, TARGET, THING, TARGET, TARGET)
    assert PREFERENCE.choose(found, 4).tolist() == [0, 1, 6, 7]
    assert PREFERENCE.choose(found, 8).tolist() == [0, 1, 2, 3, 6, 7, 8, 9]


def test_choose_prefers_the_more_alike_to_the_stronger() -> None:
    like, less_like = np.float32([0.9, 0, 0.1, 0.4]), np.float32([0.6, 0, 0.5, 0.6])
    assert PREFERENCE.choose(features(SHIRT, SHIRT, SHIRT, less_like, like), 4).tolist() == [0, 1, 2, 4]


def test_choose_takes_the_strongest_where_nothing_is_alike() -> None:
    rather_shirt = np.float32([0.5, 0.4, 0.7, 0.3])
    found = features(*[SHIRT] * 5, rather_shirt, *[np.eye(4, dtype=np.float32)[3]] * 2)
    assert PREFERENCE.choose(found, 4).tolist() == [0, 1, 2, 3]


def test_choose_keeps_a_feature_once_that_is_like_both() -> None:
    both = (THING + TARGET) / np.float32(np.sqrt(2))
    assert PREFERENCE.choose(features(*[SHIRT] * 5, both), 4).tolist() == [0, 1, 2, 5]


@pytest.mark.parametrize("count", [0, 3, 4])
def test_choose_keeps_all_of_few(count: int) -> None:
    assert PREFERENCE.choose(features(*[SHIRT] * count), 4).tolist() == list(range(count))


def test_merged_holds_what_several_prefer_within_bounds() -> None:
    assert [len(group) for group in merged([PREFERENCE] * 3).groups] == [3, 3]
    many = FeaturePreference((np.tile(THING, (MAX_GROUP, 1)), TARGET[None]), np.tile(SHIRT, (MAX_OTHERS, 1)))
    both = merged([many, PREFERENCE])
    assert [len(group) for group in both.groups] == [MAX_GROUP, 2]
    assert len(both.others) == MAX_OTHERS


def test_thinned_is_spread_evenly() -> None:
    rows = np.arange(10, dtype=np.float32)[:, None]
    assert thinned(rows, 4)[:, 0].tolist() == [0, 3, 6, 9]
    assert thinned(rows, 10) is rows


@pytest.mark.parametrize(
    ("groups", "others", "message"),
    [
        ((THING[None], TARGET[None, :3]), SHIRT[None], r"shapes \[\(1, 4\), \(1, 3\), \(1, 4\)\]; expected"),
        ((THING,), SHIRT, r"shapes \[\(4,\), \(4,\)\]; expected \[_, D\]"),
        ((THING[None][:0],), SHIRT[None], "empty or not finite"),
        ((THING[None] * np.nan,), SHIRT[None], "empty or not finite"),
    ],
)
def test_preference_refuses_other_arrays(groups: tuple[np.ndarray, ...], others: np.ndarray, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        FeaturePreference(groups, others)


def test_a_pipeline_with_a_preference_keeps_weak_features() -> None:
    """A dull disk beside a checkerboard: none of its features is among the strongest."""
    frame = np.kron(np.indices((12, 16)).sum(axis=0) % 2, np.ones((20, 20)))[..., None] * [200, 200, 200]
    frame[:, 160:] = 100
    rows, columns = np.indices(frame.shape[:2])
    for x in (200, 240, 280):
        frame[(rows - 120) ** 2 + (columns - x) ** 2 < 100] = 108
    picture = frame.astype(np.uint8)
    plain = FeaturePipeline(Sift(), max_features=20, min_side=0)
    assert (plain.extract(picture).geometry[:, 0] < 170).all()
    candidates = plain.candidates(picture)
    dull = candidates.geometry[:, 0] > 170
    preferring = plain.preferring(FeaturePreference((candidates.descriptors[dull],), candidates.descriptors[~dull]))
    kept = preferring.extract(picture)
    assert len(kept) == 20
    assert (kept.geometry[:, 0] > 170).sum() == min(5, dull.sum()) > 0
    assert preferring.identity != plain.identity == plain.preferring(None).identity
