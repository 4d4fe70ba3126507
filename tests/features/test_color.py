"""Opponent colors around a feature, on pictures of known colors."""

import numpy as np
import pytest

from geoskill.features.color import COLOR_DIM, FLOOR_RATIO, colors_around

RED, GREEN, GRAY = (120, 30, 30), (40, 160, 40), (90, 90, 90)


def as_array(*positions: tuple[float, float]) -> np.ndarray:
    return np.array(positions, np.float32).reshape(-1, 2)


def opponent(color: tuple[int, int, int], mean_brightness: float) -> list[float]:
    red, green, blue = color
    brightness = red + green + blue + FLOOR_RATIO * mean_brightness
    return [(red - green) / (2**0.5 * brightness), (red + green - 2 * blue) / (6**0.5 * brightness)]


def test_colors_of_a_uniform_picture_are_equal_in_all_samples() -> None:
    picture = np.full((40, 50, 3), RED, np.uint8)
    colors = colors_around(picture, as_array((20, 20), (49, 0)), as_array((6, 0), (0, 30)))
    assert colors.shape == (2, COLOR_DIM)
    assert colors.dtype == np.float32
    np.testing.assert_allclose(colors, [opponent(RED, 180.0) * 5] * 2, atol=1e-6)


def test_colors_of_gray_and_black_are_zero() -> None:
    for gray in (0, 90, 255):
        picture = np.full((30, 30, 3), gray, np.uint8)
        assert not colors_around(picture, as_array((15, 15)), as_array((9, 9))).any()


def halves() -> np.ndarray:
    """Return a picture that is red left of column 50 and green right of it."""
    picture = np.full((100, 100, 3), RED, np.uint8)
    picture[:, 50:] = GREEN
    return picture


@pytest.mark.parametrize(
    ("orientation_px", "green_samples"),
    [
        ((24, 0), [1]),  # to the right; the next samples are below, left and above
        ((0, 24), [4]),  # down: the sample that comes last is on the right
        ((-24, 0), [3]),
        ((0, -24), [2]),
    ],
)
def test_samples_rotate_with_the_feature(orientation_px: tuple[float, float], green_samples: list[int]) -> None:
    """The center is 8 px left of the border and one sample 4 px right of it; each averages over about 4 px.

    The two colors are 0.58 apart.
    """
    colors = colors_around(halves(), as_array((42, 50)), as_array(orientation_px)).reshape(5, 2)
    mean_brightness = (sum(RED) + sum(GREEN)) / 2
    for sample, color in enumerate(colors):
        np.testing.assert_allclose(
            color, opponent(GREEN if sample in green_samples else RED, mean_brightness), atol=0.06
        )


def test_samples_scale_with_the_feature() -> None:
    small, large = (colors_around(halves(), as_array((42, 50)), as_array((radius, 0)))[0] for radius in (12, 24))
    np.testing.assert_allclose(small[2:4], small[:2], atol=0.06)
    assert np.abs(large[2:4] - large[:2]).max() > 0.2


def test_colors_do_not_depend_on_brightness() -> None:
    picture = np.full((60, 60, 3), GRAY, np.uint8)
    picture[20:40, 20:40] = (200, 120, 40)
    features = as_array((30, 30), (22, 30)), as_array((12, 0), (0, 12))
    np.testing.assert_allclose(colors_around(picture, *features), colors_around(picture // 10, *features), atol=0.01)


def test_colors_of_a_dark_spot_in_a_bright_picture_are_small() -> None:
    picture = np.full((60, 60, 3), 255, np.uint8)
    picture[20:40, 20:40] = (6, 2, 0)
    assert np.abs(colors_around(picture, as_array((30, 30)), as_array((6, 0)))).max() < 0.05


def test_colors_outside_the_picture_are_those_of_its_border() -> None:
    colors = colors_around(halves(), as_array((-500, 50), (700, 1e4)), as_array((8, 0), (300, 0))).reshape(2, 5, 2)
    np.testing.assert_allclose(colors[0], np.broadcast_to(colors[0, 0], (5, 2)), atol=1e-6)
    assert colors[0, 0, 0] > 0 > colors[1, 0, 0]


@pytest.mark.parametrize("shape", [(1, 1, 3), (2, 3, 3), (3, 200, 3)])
def test_colors_of_a_picture_smaller_than_the_feature(shape: tuple[int, ...]) -> None:
    picture = np.full(shape, GREEN, np.uint8)
    colors = colors_around(picture, as_array((0, 0)), as_array((500, 0)))
    np.testing.assert_allclose(colors[0], opponent(GREEN, 240.0) * 5, atol=1e-6)


def test_colors_of_no_feature() -> None:
    assert colors_around(halves(), as_array(), as_array()).shape == (0, COLOR_DIM)
