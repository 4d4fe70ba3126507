"""Colors around a feature, on pictures whose colors are known."""

import numpy as np
import pytest

from geoskill.features.color import COLOR_DIM, FLOOR_SHARE, colors_around

RED, GREEN, GREY = (120, 30, 30), (40, 160, 40), (90, 90, 90)


def as_arrays(*places: tuple[float, float]) -> np.ndarray:
    return np.array(places, np.float32).reshape(-1, 2)


def opponent(color: tuple[int, int, int], mean_light: float) -> list[float]:
    red, green, blue = color
    light = red + green + blue + FLOOR_SHARE * mean_light
    return [(red - green) / (2**0.5 * light), (red + green - 2 * blue) / (6**0.5 * light)]


def test_one_color_is_the_same_in_all_places() -> None:
    picture = np.full((40, 50, 3), RED, np.uint8)
    colors = colors_around(picture, as_arrays((20, 20), (49, 0)), as_arrays((6, 0), (0, 30)))
    assert colors.shape == (2, COLOR_DIM)
    assert colors.dtype == np.float32
    np.testing.assert_allclose(colors, [opponent(RED, 180.0) * 5] * 2, atol=1e-6)


def test_gray_has_no_color_and_neither_has_black() -> None:
    for gray in (0, 90, 255):
        picture = np.full((30, 30, 3), gray, np.uint8)
        assert not colors_around(picture, as_arrays((15, 15)), as_arrays((9, 9))).any()


def halves() -> np.ndarray:
    """Red on the left, green on the right of column 50, both equally wide."""
    picture = np.full((100, 100, 3), RED, np.uint8)
    picture[:, 50:] = GREEN
    return picture


@pytest.mark.parametrize(
    ("arm", "greens"),
    [
        ((24, 0), [1]),  # toward the right; then down, left, up
        ((0, 24), [4]),  # down: its left-hand side, which comes last, is on the right
        ((-24, 0), [3]),
        ((0, -24), [2]),
    ],
)
def test_the_places_turn_with_the_feature(arm: tuple[float, float], greens: list[int]) -> None:
    """The middle is 8 px left of the border, and the place beyond it 4 px to its right; each is a mean over some 4 px,
    and the two colors are 0.58 apart.
    """
    colors = colors_around(halves(), as_arrays((42, 50)), as_arrays(arm)).reshape(5, 2)
    mean_light = (sum(RED) + sum(GREEN)) / 2
    for place, color in enumerate(colors):
        np.testing.assert_allclose(color, opponent(GREEN if place in greens else RED, mean_light), atol=0.06)


def test_the_places_grow_with_the_feature() -> None:
    small, large = (colors_around(halves(), as_arrays((42, 50)), as_arrays((arm, 0)))[0] for arm in (12, 24))
    np.testing.assert_allclose(small[2:4], small[:2], atol=0.06)
    assert np.abs(large[2:4] - large[:2]).max() > 0.2


def test_less_light_is_the_same_color() -> None:
    picture = np.full((60, 60, 3), GREY, np.uint8)
    picture[20:40, 20:40] = (200, 120, 40)
    at = as_arrays((30, 30), (22, 30)), as_arrays((12, 0), (0, 12))
    np.testing.assert_allclose(colors_around(picture, *at), colors_around(picture // 10, *at), atol=0.01)


def test_what_is_dark_in_a_bright_picture_has_little_color() -> None:
    picture = np.full((60, 60, 3), 255, np.uint8)
    picture[20:40, 20:40] = (6, 2, 0)
    assert np.abs(colors_around(picture, as_arrays((30, 30)), as_arrays((6, 0)))).max() < 0.05


def test_outside_the_picture_its_border_goes_on() -> None:
    colors = colors_around(halves(), as_arrays((-500, 50), (700, 1e4)), as_arrays((8, 0), (300, 0))).reshape(2, 5, 2)
    np.testing.assert_allclose(colors[0], np.broadcast_to(colors[0, 0], (5, 2)), atol=1e-6)
    assert colors[0, 0, 0] > 0 > colors[1, 0, 0]


@pytest.mark.parametrize("shape", [(1, 1, 3), (2, 3, 3), (3, 200, 3)])
def test_pictures_smaller_than_the_feature(shape: tuple[int, ...]) -> None:
    picture = np.full(shape, GREEN, np.uint8)
    colors = colors_around(picture, as_arrays((0, 0)), as_arrays((500, 0)))
    np.testing.assert_allclose(colors[0], opponent(GREEN, 240.0) * 5, atol=1e-6)


def test_no_feature_has_no_color() -> None:
    assert colors_around(halves(), as_arrays(), as_arrays()).shape == (0, COLOR_DIM)
