"""ORB on drawn corners and textures, and its descriptors compared with OpenCV's bits."""

import cv2
import numpy as np
import pytest

from geoskill.features.orb import Orb
from geoskill.geometry.primitives import NodeType


def texture(height: int = 240, width: int = 250, seed: int = 0) -> np.ndarray:
    noise = np.random.default_rng(seed).uniform(0, 255, (height, width)).astype(np.float32)
    smooth = cv2.GaussianBlur(noise, (0, 0), 2.0)
    return cv2.normalize(smooth, None, 0, 255, cv2.NORM_MINMAX).astype(np.uint8)


def hamming(a: np.ndarray, b: np.ndarray) -> int:
    return int(cv2.norm(a, b, cv2.NORM_HAMMING))


def test_extract_finds_the_corners_of_a_rectangle() -> None:
    picture = np.zeros((200, 220), np.uint8)
    picture[70:130, 60:150] = 200
    corners = np.array([[60, 70], [149, 70], [60, 129], [149, 129]])
    geometry = Orb().extract(picture).geometry
    distances = np.abs(geometry[:, None] - corners).max(axis=2)
    assert (distances.min(axis=0) <= 1.5).all()  # every corner has a feature
    assert (distances.min(axis=1) <= 3.0).all()  # and there is no feature elsewhere


@pytest.mark.parametrize(("height", "width"), [(240, 300), (480, 480), (373, 300)])
def test_positions_turn_with_the_picture(height: int, width: int) -> None:
    """A constant offset in any level of the pyramid would appear twice; OpenCV's own is up to 2 px."""
    picture = texture(height, width)
    features, turned = Orb().extract(picture), Orb().extract(picture[::-1, ::-1].copy())
    assert len(features) > 300
    back = np.array([width - 1, height - 1]) - turned.geometry
    nearest = np.linalg.norm(features.geometry[:, None] - back, axis=2).min(axis=1)
    assert np.median(nearest) < 1e-3
    assert np.mean(nearest < 0.3) > 0.85


def test_dot_product_is_one_minus_twice_the_ratio_of_different_bits() -> None:
    _, packed = cv2.ORB.create(nfeatures=2000, fastThreshold=10).detectAndCompute(texture(), None)
    features = Orb().extract(texture())
    assert len(features) > 100
    bits = np.packbits(features.descriptors > 0, axis=1)
    assert {row.tobytes() for row in bits} <= {row.tobytes() for row in packed}
    for i, j in np.random.default_rng(0).integers(len(features), size=(100, 2)):
        expected = 1 - 2 * hamming(bits[i], bits[j]) / 256
        assert features.descriptors[i] @ features.descriptors[j] == pytest.approx(expected, abs=1e-6)


def test_descriptors_have_unit_norm_and_two_values() -> None:
    features = Orb().extract(texture())
    assert features.node_type is NodeType.POINT
    assert features.descriptors.shape == (len(features), 256)
    assert features.descriptors.dtype == np.float32
    assert np.unique(features.descriptors).tolist() == [-1 / 16, 1 / 16]


def test_descriptors_belong_to_their_positions() -> None:
    """Sorting by score must keep descriptors with their keypoints: OpenCV orders keypoints by level of the pyramid.

    A feature of the first level has OpenCV's position, which identifies its row in OpenCV's result.
    """
    keypoints, packed = cv2.ORB.create(nfeatures=2000, fastThreshold=10).detectAndCompute(texture(), None)
    rows = {(k.pt, np.float32(k.response)): row for row, k in enumerate(keypoints) if k.octave == 0}
    features = Orb().extract(texture())
    checked = 0
    for xy, score, descriptor in zip(features.geometry, features.scores, features.descriptors, strict=True):
        row = rows.get((tuple(xy.tolist()), score))
        if row is not None:
            assert np.packbits(descriptor > 0).tolist() == packed[row].tolist()
            checked += 1
    assert checked > 100


def test_scores_decrease_across_levels() -> None:
    keypoints = cv2.ORB.create(nfeatures=2000, fastThreshold=10).detect(texture(), None)
    assert len({k.octave for k in keypoints}) > 3
    assert np.any(np.diff([k.response for k in keypoints]) > 0)  # OpenCV's are not sorted
    features = Orb().extract(texture())
    assert np.all(np.diff(features.scores) <= 0)
    assert features.scores[0] == pytest.approx(max(k.response for k in keypoints))


def test_extract_returns_one_feature_per_pixel() -> None:
    pixels = np.round(Orb().extract(texture()).geometry)
    assert len(np.unique(pixels, axis=0)) == len(pixels)


def test_arguments_change_the_detector() -> None:
    assert len(Orb(candidates=50).extract(texture())) <= 50 < len(Orb().extract(texture()))
    dull = (texture() // 16 + 100).astype(np.uint8)
    assert len(Orb(fast_threshold=3).extract(dull)) > len(Orb(fast_threshold=10).extract(dull))


def test_extract_is_deterministic() -> None:
    first, second = Orb().extract(texture()), Orb().extract(texture())
    for name in ("descriptors", "geometry", "scores"):
        np.testing.assert_array_equal(getattr(first, name), getattr(second, name))


@pytest.mark.parametrize("shape", [(120, 160), (1, 1), (2, 3), (62, 62), (40, 300)])
def test_extract_from_a_black_or_tiny_picture_is_empty(shape: tuple[int, int]) -> None:
    noise = np.random.default_rng(0).integers(0, 256, shape, dtype=np.uint8)
    for picture in [np.zeros(shape, np.uint8)] + ([noise] if min(shape) <= 62 else []):
        features = Orb().extract(picture)
        assert features.descriptors.shape == (0, 256)
        assert features.geometry.shape == (0, 2)
        assert features.scores.shape == (0,)
