"""Whether a place looks as it did, on a picture of smooth noise."""

import cv2
import numpy as np
import pytest

from geoskill.geometry.primitives import NodeType
from geoskill.tracking.appearance import SHARES, SIDE_PX, are_alike, patches_at


@pytest.fixture(scope="module")
def picture() -> np.ndarray:
    noise = np.random.default_rng(0).normal(size=(100, 140)).astype(np.float32)
    smooth = np.asarray(cv2.GaussianBlur(noise, (0, 0), 2.0))
    return np.clip(128 + 40 * smooth / smooth.std(), 0, 255).astype(np.uint8)


def test_patches_lie_around_a_point_and_along_a_segment(picture: np.ndarray) -> None:
    half = SIDE_PX // 2
    (patch,) = patches_at(picture, NodeType.POINT, (40.0, 30.0))
    np.testing.assert_array_equal(patch, picture[30 - half : 31 + half, 40 - half : 41 + half])
    along = patches_at(picture, NodeType.LINE, (20.0, 40.0, 60.0, 40.0))
    assert along.shape == (len(SHARES), SIDE_PX, SIDE_PX)
    np.testing.assert_array_equal(along[1], picture[40 - half : 41 + half, 40 - half : 41 + half])


@pytest.mark.parametrize("place", [(40.0, 30.0), (40.5, 30.25), (0.0, 0.0), (139.0, 99.0)])
def test_a_place_is_like_itself_in_other_light_and_with_noise(picture: np.ndarray, place: tuple[float, float]) -> None:
    before = patches_at(picture, NodeType.POINT, place)
    noise = np.random.default_rng(1).normal(0, 4, picture.shape)
    darker = np.clip(0.4 * picture + 10 + noise, 0, 255).astype(np.uint8)
    assert are_alike(before, before)
    assert are_alike(before, patches_at(darker, NodeType.POINT, place))


def test_a_place_is_like_no_other(picture: np.ndarray) -> None:
    before = patches_at(picture, NodeType.POINT, (40.0, 30.0))
    for place in ((55.0, 30.0), (40.0, 60.0), (100.0, 70.0)):
        assert not are_alike(before, patches_at(picture, NodeType.POINT, place))
    assert not are_alike(before, 255 - before)


def test_what_has_no_texture_is_like_nothing(picture: np.ndarray) -> None:
    flat = np.full((1, SIDE_PX, SIDE_PX), 90, np.float32)
    assert not are_alike(flat, flat)
    assert not are_alike(patches_at(picture, NodeType.POINT, (40.0, 30.0)), flat)


@pytest.mark.parametrize(("covered", "alike"), [(1, True), (2, False)])
def test_most_of_a_segment_must_be_as_it_was(picture: np.ndarray, covered: int, alike: bool) -> None:
    segment = (15.0, 40.0, 115.0, 40.0)
    later = picture.copy()
    later[:, : {1: 52, 2: 75}[covered]] = 90
    before, after = (patches_at(each, NodeType.LINE, segment) for each in (picture, later))
    assert are_alike(before, after) is alike
