"""Surfaces drawn at rng."""

from collections.abc import Callable
from functools import partial

import cv2
import numpy as np
import pytest

from geoskill.simulation import textures
from geoskill.simulation.textures import SIZE

GREY = (150, 140, 130)
KINDS: dict[str, Callable[[np.random.Generator], np.ndarray]] = {
    "print": partial(textures.print_on_card, paper=GREY),
    "wood": partial(textures.wood, color=GREY),
    "felt": partial(textures.felt, color=GREY),
    "stone": partial(textures.stone, color=GREY),
    "cloth": partial(textures.printed_cloth, ground=GREY),
    "stripes": partial(textures.striped_print, paper=GREY, along=(0.3, 0.7), across=(0.5,)),
    "metal": partial(textures.metal, color=GREY),
    "skin": partial(textures.skin, color=GREY),
}


def corners(image: np.ndarray) -> int:
    """How many corners a detector finds after a little blur, at the strength of a clear one."""
    gray = cv2.GaussianBlur(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY), (0, 0), 2.0)
    response = cv2.cornerMinEigenVal(gray, 7)
    peaks = (response == cv2.dilate(response, np.ones((15, 15)))) & (response > 1e-3)
    return int(peaks.sum())


@pytest.mark.parametrize("kind", KINDS)
def test_size_color_and_seed(kind: str) -> None:
    image = KINDS[kind](np.random.default_rng(0))
    assert (image.shape, image.dtype) == ((SIZE, SIZE, 3), np.uint8)
    np.testing.assert_array_equal(image, KINDS[kind](np.random.default_rng(0)))
    assert np.abs(image.astype(int) - KINDS[kind](np.random.default_rng(1))).mean() > 1
    np.testing.assert_allclose(np.median(image, axis=(0, 1)), GREY, atol=20)
    assert image.reshape(-1, 3).std(axis=0).min() > 2  # no real surface is of one color


@pytest.mark.parametrize("rich", ["print", "stripes", "cloth"])
@pytest.mark.parametrize("plain", ["wood", "felt", "metal", "skin"])
def test_prints_have_more_corners_than_anything_plain(rich: str, plain: str) -> None:
    assert corners(KINDS[rich](np.random.default_rng(0))) > 3 * corners(KINDS[plain](np.random.default_rng(0)))


def test_stripes_are_where_they_are_to_be() -> None:
    image = KINDS["stripes"](np.random.default_rng(0)).astype(float).mean(axis=2)
    for place in (0.3, 0.7):
        middle = round(place * SIZE)
        assert image[:, middle - 3 : middle + 3].mean() < image[:, [middle - 12, middle + 12]].mean() - 30
    middle = SIZE // 2
    assert image[middle - 3 : middle + 3].mean() < image[[middle - 12, middle + 12]].mean() - 30


def test_less_contrast_is_less() -> None:
    spreads = [
        textures.print_on_card(np.random.default_rng(0), GREY, contrast=contrast)[50:-50, 50:-50].std()
        for contrast in (0.0, 0.5, 1.0)
    ]
    assert spreads[0] < 0.5 * spreads[1] < spreads[1] < spreads[2]
