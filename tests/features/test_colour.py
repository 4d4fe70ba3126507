"""Colours around a feature, on pictures whose colours are known."""

import numpy as np
import pytest

from geoskill.features.colour import COLOUR_DIM, FLOOR_SHARE, colours_around

RED, GREEN, GREY = (120, 30, 30), (40, 160, 40), (90, 90, 90)


def as_arrays(*places: tuple[float, float]) -> np.ndarray:
    return np.array(places, np.float32).reshape(-1, 2)


def opponent(colour: tuple[int, int, int], mean_light: float) -> list[float]:
    red, green, blue = colour
    light = red + green + blue + FLOOR_SHARE * mean_light
    return [(red - green) / (2**0.5 * light), (red + green - 2 * blue) / (6**0.5 * light)]


def test_one_colour_is_the_same_in_all_places() -> None:
    picture = np.full((40, 50, 3), RED, np.uint8)
    colours = colours_around(picture, as_arrays((20, 20), (49, 0)), as_arrays((6, 0), (0, 30)))
    assert colours.shape == (2, COLOUR_DIM)
    assert colours.dtype == np.float32
    np.testing.assert_allclose(colours, [opponent(RED, 180.0) * 5] * 2, atol=1e-6)


def test_grey_has_no_colour_and_neither_has_black() -> None:
    for grey in (0, 90, 255):
        picture = np.full((30, 30, 3), grey, np.uint8)
        assert not colours_around(picture, as_arrays((15, 15)), as_arrays((9, 9))).any()


def halves() -> np.ndarray:
    """Red on the left, green on the right of column 50, both equally wide."""
    picture = np.full((100, 100, 3), RED, np.uint8)
    picture[:, 50:] = GREEN
    return picture


@pytest.mark.parametrize(
    ("arm", "greens"),
    [
        ((24, 0), [1]),  # towards the right; then down, left, up
        ((0, 24), [4]),  # down: its left-hand side, which comes last, is on the right
        ((-24, 0), [3]),
        ((0, -24), [2]),
    ],
)
def test_the_places_turn_with_the_feature(arm: tuple[float, float], greens: list[int]) -> None:
    """The middle is 8 px left of the border, and the place beyond it 4 px to its right; each is a mean over some 4 px,
    and the two colours are 0.58 apart.
    """
    colours = colours_around(halves(), as_arrays((42, 50)), as_arrays(arm)).reshape(5, 2)
    mean_light = (sum(RED) + sum(GREEN)) / 2
    for place, colour in enumerate(colours):
        np.testing.assert_allclose(colour, opponent(GREEN if place in greens else RED, mean_light), atol=0.06)


def test_the_places_grow_with_the_feature() -> None:
    small, large = (colours_around(halves(), as_arrays((42, 50)), as_arrays((arm, 0)))[0] for arm in (12, 24))
    np.testing.assert_allclose(small[2:4], small[:2], atol=0.06)
    assert np.abs(large[2:4] - large[:2]).max() > 0.2


def test_less_light_is_the_same_colour() -> None:
    picture = np.full((60, 60, 3), GREY, np.uint8)
    picture[20:40, 20:40] = (200, 120, 40)
    at = as_arrays((30, 30), (22, 30)), as_arrays((12, 0), (0, 12))
    np.testing.assert_allclose(colours_around(picture, *at), colours_around(picture // 10, *at), atol=0.01)


def test_what_is_dark_in_a_bright_picture_has_little_colour() -> None:
    picture = np.full((60, 60, 3), 255, np.uint8)
    picture[20:40, 20:40] = (6, 2, 0)
    assert np.abs(colours_around(picture, as_arrays((30, 30)), as_arrays((6, 0)))).max() < 0.05


def test_outside_the_picture_its_border_goes_on() -> None:
    colours = colours_around(halves(), as_arrays((-500, 50), (700, 1e4)), as_arrays((8, 0), (300, 0))).reshape(2, 5, 2)
    np.testing.assert_allclose(colours[0], np.broadcast_to(colours[0, 0], (5, 2)), atol=1e-6)
    assert colours[0, 0, 0] > 0 > colours[1, 0, 0]


@pytest.mark.parametrize("shape", [(1, 1, 3), (2, 3, 3), (3, 200, 3)])
def test_pictures_smaller_than_the_feature(shape: tuple[int, ...]) -> None:
    picture = np.full(shape, GREEN, np.uint8)
    colours = colours_around(picture, as_arrays((0, 0)), as_arrays((500, 0)))
    np.testing.assert_allclose(colours[0], opponent(GREEN, 240.0) * 5, atol=1e-6)


def test_no_feature_has_no_colour() -> None:
    assert colours_around(halves(), as_arrays(), as_arrays()).shape == (0, COLOUR_DIM)
