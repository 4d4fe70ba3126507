"""Comparison of patches on a picture of smooth noise."""

import cv2
import numpy as np
import pytest

from geoskill.geometry.primitives import NodeType
from geoskill.tracking.appearance import SEGMENT_FRACTIONS, SIDE_PX, matches, patches_at


@pytest.fixture(scope="module")
def picture() -> np.ndarray:
    noise = np.random.default_rng(0).normal(size=(100, 140)).astype(np.float32)
    smooth = np.asarray(cv2.GaussianBlur(noise, (0, 0), 2.0))
    return np.clip(128 + 40 * smooth / smooth.std(), 0, 255).astype(np.uint8)


def test_patches_at_a_point_and_along_a_segment(picture: np.ndarray) -> None:
    half = SIDE_PX // 2
    (patch,) = patches_at(picture, NodeType.POINT, (40.0, 30.0))
    np.testing.assert_array_equal(patch, picture[30 - half : 31 + half, 40 - half : 41 + half])
    along = patches_at(picture, NodeType.LINE, (20.0, 40.0, 60.0, 40.0))
    assert along.shape == (len(SEGMENT_FRACTIONS), SIDE_PX, SIDE_PX)
    np.testing.assert_array_equal(along[1], picture[40 - half : 41 + half, 40 - half : 41 + half])


@pytest.mark.parametrize("position", [(40.0, 30.0), (40.5, 30.25), (0.0, 0.0), (139.0, 99.0)])
def test_matches_in_other_light_and_with_noise(picture: np.ndarray, position: tuple[float, float]) -> None:
    before = patches_at(picture, NodeType.POINT, position)
    noise = np.random.default_rng(1).normal(0, 4, picture.shape)
    darker = np.clip(0.4 * picture + 10 + noise, 0, 255).astype(np.uint8)
    assert matches(before, before)
    assert matches(before, patches_at(darker, NodeType.POINT, position))


def test_matches_no_other_position(picture: np.ndarray) -> None:
    before = patches_at(picture, NodeType.POINT, (40.0, 30.0))
    for position in ((55.0, 30.0), (40.0, 60.0), (100.0, 70.0)):
        assert not matches(before, patches_at(picture, NodeType.POINT, position))
    assert not matches(before, 255 - before)


def test_matches_nothing_without_texture(picture: np.ndarray) -> None:
    flat = np.full((1, SIDE_PX, SIDE_PX), 90, np.float32)
    assert not matches(flat, flat)
    assert not matches(patches_at(picture, NodeType.POINT, (40.0, 30.0)), flat)


@pytest.mark.parametrize(("covered", "expected"), [(1, True), (2, False)])
def test_matches_most_patches_of_a_segment(picture: np.ndarray, covered: int, expected: bool) -> None:
    segment = (15.0, 40.0, 115.0, 40.0)
    later = picture.copy()
    later[:, : {1: 52, 2: 75}[covered]] = 90
    before, after = (patches_at(image, NodeType.LINE, segment) for image in (picture, later))
    assert matches(before, after) is expected
