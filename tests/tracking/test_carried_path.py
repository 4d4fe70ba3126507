"""The path of the carried thing: the best of all paths, and where a drawn thing is."""

from itertools import product

import numpy as np
import pytest

from geoskill.tracking.carried_path import best_path
from geoskill.tracking.places import find_places
from tests.carrying import BELOW_THE_HAND, PUTS, TAKES, Carrying, draw, hand_xy


@pytest.mark.parametrize("seed", range(5))
def test_best_path_is_the_best_of_all(seed: int) -> None:
    random = np.random.default_rng(seed)
    values = random.normal(0, 1, (4, 2, 3)).astype(np.float32)
    start, end, far = np.array([0.2, 0.0]), np.array([1.0, 2.4]), 1.5
    found = best_path(values, start, end, far)

    def total(path: np.ndarray) -> float:
        steps = np.diff(path, axis=0)
        return float(values[np.arange(4), path[:, 0], path[:, 1]].sum() - (steps**2).sum() / far**2)

    cells = list(product(range(2), range(3)))
    others = [np.array([(0, 0), *middle, (1, 2)]) for middle in product(cells, repeat=2)]
    assert found[0].tolist() == [0, 0]
    assert found[-1].tolist() == [1, 2]
    assert total(found) == pytest.approx(max(map(total, others)))


def test_best_path_of_one_picture() -> None:
    cell = np.array([1.0, 1.0])
    assert best_path(np.zeros((1, 2, 2), np.float32), cell, cell, 1.0).tolist() == [[1, 1]]


@pytest.mark.parametrize(
    "carrying",
    [Carrying(), Carrying(turned=60), Carrying(half_size=(14, 14))],
    ids=["carried", "turned", "large"],
)
def test_the_thing_is_followed_between_its_places(carrying: Carrying) -> None:
    places = find_places(draw(carrying))
    assert places is not None
    path = places.path
    assert path.frames.tolist() == list(range(places.picked, places.placed + 1))
    between = (path.frames >= TAKES) & (path.frames < PUTS)
    drawn = np.array([hand_xy(int(t), carrying) + BELOW_THE_HAND for t in path.frames])
    off_px = np.linalg.norm(path.centers - drawn, axis=1)[between & path.seen]
    assert path.seen[between].mean() > 0.8
    assert np.median(off_px) < path.size_px / 4
    assert off_px.max() < path.size_px
    assert path.number(TAKES - 8) is None
    middle = (TAKES + PUTS) // 2
    assert path.frames[path.number(middle)] == middle
