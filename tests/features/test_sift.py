"""SIFT on blobs with known centers, and its descriptors compared with OpenCV's."""

import cv2
import numpy as np
import pytest

from geoskill.features.sift import Sift
from geoskill.geometry.primitives import NodeType


def picture_of_blobs(*blobs: tuple[float, float, float, float], height: int = 160, width: int = 200) -> np.ndarray:
    """Draw Gaussian blobs (x, y, standard deviation, height) on black."""
    y, x = np.mgrid[:height, :width]
    picture = np.zeros((height, width))
    for center_x, center_y, sigma, peak in blobs:
        picture += peak * np.exp(-((x - center_x) ** 2 + (y - center_y) ** 2) / (2 * sigma**2))
    return np.clip(np.round(picture), 0, 255).astype(np.uint8)


def texture(height: int = 240, width: int = 250, seed: int = 0) -> np.ndarray:
    noise = np.random.default_rng(seed).uniform(0, 255, (height, width)).astype(np.float32)
    smooth = cv2.GaussianBlur(noise, (0, 0), 2.0)
    return cv2.normalize(smooth, None, 0, 255, cv2.NORM_MINMAX).astype(np.uint8)


@pytest.mark.parametrize("sigma", [2.0, 3.0, 4.5, 6.0])
@pytest.mark.parametrize("center", [(60.0, 60.0), (90.3, 70.7), (120.5, 50.5), (75.75, 99.25)])
def test_extract_finds_a_blob_at_its_center(center: tuple[float, float], sigma: float) -> None:
    features = Sift().extract(picture_of_blobs((*center, sigma, 200.0)))
    assert len(features) > 0
    # OpenCV's imprecise upscale would shift it by a quarter of a pixel.
    np.testing.assert_allclose(features.geometry[0], center, atol=0.06)


def test_positions_turn_with_the_picture() -> None:
    picture = texture()
    features, turned = Sift().extract(picture), Sift().extract(picture[::-1, ::-1].copy())
    assert len(features) > 200
    back = np.array([picture.shape[1] - 1, picture.shape[0] - 1]) - turned.geometry
    nearest = np.linalg.norm(features.geometry[:, None] - back, axis=2).min(axis=1)
    assert np.mean(nearest < 0.02) > 0.8
    assert np.median(nearest) < 0.01


def test_scores_order_blobs_by_contrast() -> None:
    features = Sift().extract(picture_of_blobs((40, 40, 4, 80), (100, 40, 4, 220), (40, 110, 4, 140)))
    blobs = [point for point in features.geometry.round().tolist() if point in ([40, 40], [100, 40], [40, 110])]
    assert blobs == [[100, 40], [40, 110], [40, 40]]
    assert np.all(np.diff(features.scores) <= 0)


@pytest.mark.parametrize("root", [False, True])
def test_descriptors_have_unit_norm(root: bool) -> None:
    features = Sift(root=root).extract(texture())
    assert features.node_type is NodeType.POINT
    assert features.descriptors.shape == (len(features), 128)
    assert features.descriptors.dtype == np.float32
    np.testing.assert_allclose(np.linalg.norm(features.descriptors, axis=1), 1.0, atol=1e-6)


def test_root_sift_gives_the_hellinger_kernel() -> None:
    """Dot products are Hellinger kernels of the L1-normalized histograms (Arandjelovic and Zisserman, section 2)."""
    plain, root = Sift().extract(texture()), Sift(root=True).extract(texture())
    np.testing.assert_array_equal(plain.geometry, root.geometry)
    histograms = plain.descriptors[:50].astype(np.float64)
    histograms /= histograms.sum(axis=1, keepdims=True)
    hellinger = np.sqrt(histograms[:, None] * histograms).sum(axis=2)
    np.testing.assert_allclose(root.descriptors[:50] @ root.descriptors[:50].T, hellinger, atol=1e-5)
    assert np.abs(root.descriptors - plain.descriptors).max() > 0.01


def test_descriptors_belong_to_their_positions() -> None:
    """Descriptors equal OpenCV's for the same keypoints, although keypoints are sorted and some removed."""
    detector = cv2.SIFT.create(contrastThreshold=0.01, enable_precise_upscale=True)
    keypoints, histograms = detector.detectAndCompute(texture(), None)
    by_position: dict[tuple[float, float], list[np.ndarray]] = {}
    for keypoint, histogram in zip(keypoints, histograms, strict=True):
        by_position.setdefault(keypoint.pt, []).append(histogram / np.linalg.norm(histogram))
    features = Sift().extract(texture())
    for position, descriptor in zip(features.geometry.tolist(), features.descriptors, strict=True):
        assert min(np.abs(descriptor - candidate).max() for candidate in by_position[tuple(position)]) < 1e-6


def test_extract_returns_one_feature_per_pixel() -> None:
    # A blob has no direction, so the detector reports it several times, with different directions.
    picture = picture_of_blobs((60, 60, 3, 200))
    assert len(cv2.SIFT.create(contrastThreshold=0.01, enable_precise_upscale=True).detect(picture, None)) > 1
    assert len(Sift().extract(picture)) == 1
    pixels = np.round(Sift().extract(texture()).geometry)
    assert len(np.unique(pixels, axis=0)) == len(pixels)


def test_contrast_threshold_admits_fainter_blobs() -> None:
    faint = picture_of_blobs((60, 60, 4, 12))
    assert len(Sift(contrast_threshold=0.01).extract(faint)) == 1
    assert len(Sift(contrast_threshold=0.04).extract(faint)) == 0


def test_extract_is_deterministic() -> None:
    first, second = Sift().extract(texture()), Sift().extract(texture())
    for name in ("descriptors", "geometry", "scores"):
        np.testing.assert_array_equal(getattr(first, name), getattr(second, name))


@pytest.mark.parametrize("shape", [(120, 160), (1, 1), (2, 3), (1, 200)])
def test_extract_from_a_black_picture_is_empty(shape: tuple[int, int]) -> None:
    features = Sift().extract(np.zeros(shape, np.uint8))
    assert features.descriptors.shape == (0, 128)
    assert features.geometry.shape == (0, 2)
    assert features.scores.shape == (0,)
