"""Random textures."""

from collections.abc import Callable
from functools import partial

import cv2
import numpy as np
import pytest

from geoskill.simulation import textures
from geoskill.simulation.textures import SIZE

GRAY = (150, 140, 130)
TEXTURES: dict[str, Callable[[np.random.Generator], np.ndarray]] = {
    "print": partial(textures.print_on_card, paper=GRAY),
    "wood": partial(textures.wood, color=GRAY),
    "felt": partial(textures.felt, color=GRAY),
    "stone": partial(textures.stone, color=GRAY),
    "cloth": partial(textures.printed_cloth, ground=GRAY),
    "stripes": partial(textures.striped_print, paper=GRAY, along=(0.3, 0.7), across=(0.5,)),
    "metal": partial(textures.metal, color=GRAY),
    "skin": partial(textures.skin, color=GRAY),
}


def count_corners(image: np.ndarray) -> int:
    """Count the clear corners that a detector finds after a slight blur."""
    gray = cv2.GaussianBlur(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY), (0, 0), 2.0)
    response = cv2.cornerMinEigenVal(gray, 7)
    peaks = (response == cv2.dilate(response, np.ones((15, 15)))) & (response > 1e-3)
    return int(peaks.sum())


@pytest.mark.parametrize("texture", TEXTURES)
def test_texture_has_its_size_and_color_and_depends_on_the_seed(texture: str) -> None:
    image = TEXTURES[texture](np.random.default_rng(0))
    assert (image.shape, image.dtype) == ((SIZE, SIZE, 3), np.uint8)
    np.testing.assert_array_equal(image, TEXTURES[texture](np.random.default_rng(0)))
    assert np.abs(image.astype(int) - TEXTURES[texture](np.random.default_rng(1))).mean() > 1
    np.testing.assert_allclose(np.median(image, axis=(0, 1)), GRAY, atol=20)
    assert image.reshape(-1, 3).std(axis=0).min() > 2  # no real surface has one uniform color


@pytest.mark.parametrize("rich", ["print", "stripes", "cloth"])
@pytest.mark.parametrize("plain", ["wood", "felt", "metal", "skin"])
def test_prints_have_more_corners_than_plain_textures(rich: str, plain: str) -> None:
    assert count_corners(TEXTURES[rich](np.random.default_rng(0))) > 3 * count_corners(
        TEXTURES[plain](np.random.default_rng(0))
    )


def test_striped_print_has_its_stripes_at_the_given_positions() -> None:
    image = TEXTURES["stripes"](np.random.default_rng(0)).astype(float).mean(axis=2)
    for position in (0.3, 0.7):
        center = round(position * SIZE)
        assert image[:, center - 3 : center + 3].mean() < image[:, [center - 12, center + 12]].mean() - 30
    center = SIZE // 2
    assert image[center - 3 : center + 3].mean() < image[[center - 12, center + 12]].mean() - 30


def test_print_contrast_scales_the_deviation() -> None:
    deviations = [
        textures.print_on_card(np.random.default_rng(0), GRAY, contrast=contrast)[50:-50, 50:-50].std()
        for contrast in (0.0, 0.5, 1.0)
    ]
    assert deviations[0] < 0.5 * deviations[1] < deviations[1] < deviations[2]
