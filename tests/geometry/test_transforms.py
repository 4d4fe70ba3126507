"""Homographies and the pixel-centre convention of resizing."""

import cv2
import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from geoskill.geometry.transforms import apply_homography, rescale_points

few_examples = settings(max_examples=40, deadline=None)


def test_homography_of_a_shift_a_scaling_and_a_perspective() -> None:
    points = np.array([[2.0, 6.0], [0.0, -1.0]])
    shift = np.array([[1.0, 0, 3], [0, 1, -2], [0, 0, 1]])
    np.testing.assert_array_equal(apply_homography(shift, points), [[5, 4], [3, -3]])
    np.testing.assert_array_equal(apply_homography(np.diag([2.0, 3, 1]), points), [[4, 18], [0, -3]])
    perspective = np.array([[1.0, 0, 0], [0, 1, 0], [0.5, 0, 1]])
    np.testing.assert_array_equal(apply_homography(perspective, points), [[1, 3], [0, -1]])


def test_homography_agrees_with_opencv_and_between_arrays_and_tensors() -> None:
    rng = np.random.default_rng(0)
    homography = np.eye(3) + 1e-3 * rng.normal(size=(3, 3))
    points = rng.uniform(0, 640, (50, 2))
    expected = cv2.perspectiveTransform(points[:, None], homography)[:, 0]
    np.testing.assert_allclose(apply_homography(homography, points), expected, rtol=1e-12)
    mapped = apply_homography(torch.from_numpy(homography), torch.from_numpy(points))
    np.testing.assert_allclose(mapped.numpy(), expected, rtol=1e-12)


@pytest.mark.parametrize("scale", [-1.0, 1e-3, 40.0])
def test_homography_does_not_depend_on_its_homogeneous_scale(scale: float) -> None:
    homography = np.array([[1.1, 0.1, 3], [-0.2, 0.9, 5], [1e-3, 2e-3, 1]])
    points = np.array([[10.0, 20.0], [300.0, 7.0]])
    np.testing.assert_allclose(apply_homography(scale * homography, points), apply_homography(homography, points))


def test_homography_is_differentiable_and_keeps_the_dtype() -> None:
    homography = torch.tensor([[1.1, 0.1, 3], [-0.2, 0.9, 5], [1e-3, 2e-3, 1]], dtype=torch.float64)
    points = torch.tensor([[10.0, 20.0], [300.0, 7.0]], dtype=torch.float64)
    assert torch.autograd.gradcheck(apply_homography, (homography.requires_grad_(), points.requires_grad_()))
    assert apply_homography(homography.detach().float(), points.detach().float()).dtype == torch.float32
    assert apply_homography(np.eye(3, dtype=np.float32), np.ones((1, 2), np.float32)).dtype == np.float32


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
    with pytest.raises(ValueError, match=r"shape \(1, 3\); expected \[n, 2\] or \[n, 4\]"):
        rescale_points(np.zeros((1, 3)), 1.0, 1.0)
