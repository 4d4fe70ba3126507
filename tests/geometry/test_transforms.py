"""The pixel-center convention of resizing."""

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from geoskill.geometry.transforms import rescale_points

few_examples = settings(max_examples=40, deadline=None)


def centroid(image: np.ndarray) -> np.ndarray:
    y, x = np.mgrid[: image.shape[0], : image.shape[1]]
    return np.array([(image * x).sum() / image.sum(), (image * y).sum() / image.sum()])


@pytest.mark.parametrize(
    ("size", "interpolation"),
    [((240, 160), cv2.INTER_LINEAR), ((60, 40), cv2.INTER_AREA), ((60, 120), cv2.INTER_LINEAR)],
)
def test_rescaling_follows_a_blob_through_cv2_resize(size: tuple[int, int], interpolation: int) -> None:
    width, height, x, y = 120, 80, 40.3, 51.6
    row, column = np.mgrid[:height, :width]
    picture = np.exp(-((column - x) ** 2 + (row - y) ** 2) / (2 * 4.0**2))
    resized = cv2.resize(picture, size, interpolation=interpolation)
    expected = rescale_points(np.array([[x, y]]), size[0] / width, size[1] / height)[0]
    np.testing.assert_allclose(centroid(resized), expected, atol=1e-3)
    without_the_half_pixel = np.array([x * size[0] / width, y * size[1] / height])
    assert np.abs(without_the_half_pixel - expected).max() > 0.2, "the picture must be able to tell the conventions"


def test_rescaling_points_and_segments_by_hand() -> None:
    np.testing.assert_array_equal(rescale_points(np.array([[1.5, 0.0]]), 2.0, 2.0), [[3.5, 0.5]])
    np.testing.assert_array_equal(
        rescale_points(np.array([[0.0, 1.0, 3.5, 7.5]]), 0.5, 0.25), [[-0.25, -0.125, 1.5, 1.5]]
    )
    assert rescale_points(np.zeros((0, 4), np.float32), 2.0, 3.0).shape == (0, 4)
    assert rescale_points(np.zeros((2, 2), np.float32), 2.0, 3.0).dtype == np.float32


@few_examples
@given(st.floats(-100, 2000), st.floats(-100, 2000), st.floats(0.05, 20), st.floats(0.05, 20))
def test_the_inverse_factors_lead_back(x: float, y: float, factor_x: float, factor_y: float) -> None:
    points = np.array([[x, y]])
    there = rescale_points(points, factor_x, factor_y)
    np.testing.assert_allclose(rescale_points(there, 1 / factor_x, 1 / factor_y), points, atol=1e-8)


@pytest.mark.parametrize("factors", [(0.0, 1.0), (1.0, -2.0), (float("nan"), 1.0), (1.0, float("inf"))])
def test_impossible_factors_are_refused(factors: tuple[float, float]) -> None:
    with pytest.raises(ValueError, match=r"scale factors are .* expected positive"):
        rescale_points(np.zeros((1, 2)), *factors)


def test_rows_of_other_widths_are_refused() -> None:
    with pytest.raises(ValueError, match=r"shape \(1, 3\); expected x and y in turn"):
        rescale_points(np.zeros((1, 3)), 1.0, 1.0)
