"""Tests of the overlay's colors, scale and text."""

import numpy as np
import pytest

from geoskill.viz.drawing import TOP_COLOR, Scale, draw_text, rank_color, text_size, truncated


def test_rank_color() -> None:
    assert rank_color(1) == TOP_COLOR
    others = [rank_color(rank) for rank in range(2, 11)]
    assert len({*others, TOP_COLOR}) == 10
    assert rank_color(11) == rank_color(2)


@pytest.mark.parametrize(
    ("shape", "factor", "unit", "text"),
    [
        ((240, 320), 2, 1.0, 853 / 640),
        ((500, 479), 2, 479 / 240, (958 + 319) / 640),
        ((960, 960), 1, 2.0, 2.0),
        ((1, 9), 480, 1.0, 2.5),  # of a panorama, text is no larger
    ],
)
def test_scale(shape: tuple[int, int], factor: int, unit: float, text: float) -> None:
    scale = Scale.of(np.zeros((*shape, 3), np.uint8))
    assert scale == (factor, pytest.approx(unit), pytest.approx(text))
    assert scale.px(10) == round(10 * unit)
    assert scale.px(0) == 1
    # Pixel x covers factor * x to factor * (x + 1) - 1.
    np.testing.assert_allclose(scale.enlarged(np.array([[0.0, 1.0]])), [[(factor - 1) / 2, factor + (factor - 1) / 2]])


def test_truncated() -> None:
    width = text_size("control error", 0.5)[0]
    assert truncated("control error", width, 0.5) == "control error"
    shortened = truncated("control error of the top association", width, 0.5)
    assert shortened.endswith("...")
    assert text_size(shortened, 0.5)[0] <= width
    assert truncated("control", 0, 0.5) == "..."


def test_draw_text_replaces_characters_outside_ascii() -> None:
    canvases = [np.zeros((30, 60, 3), np.uint8) for _ in range(2)]
    for canvas, text in zip(canvases, ("ä1", "?1"), strict=True):
        draw_text(canvas, text, (2, 20), 0.5, TOP_COLOR)
    np.testing.assert_array_equal(*canvases)
    assert canvases[0].any()
