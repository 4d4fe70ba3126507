"""Pixel patches of SIFT's keypoints, in their direction and scale."""

import cv2
import numpy as np
import pytest

from geoskill.features.patch import SIDE, PixelPatch, sample_patches
from geoskill.features.sift import Sift
from geoskill.geometry.primitives import NodeType


def texture(height: int = 240, width: int = 250) -> np.ndarray:
    noise = np.random.default_rng(0).uniform(0, 255, (height, width)).astype(np.float32)
    smooth = cv2.GaussianBlur(noise, (0, 0), 2.0)
    return cv2.normalize(smooth, None, 0, 255, cv2.NORM_MINMAX).astype(np.uint8)


def test_keypoints_are_those_of_sift() -> None:
    patches, histograms = PixelPatch().extract(texture(), 50), Sift().extract(texture(), 50)
    assert patches.node_type is NodeType.POINT
    assert np.array_equal(patches.geometry, histograms.geometry)
    assert np.array_equal(patches.scores, histograms.scores)
    assert patches.orientation_px is not None
    assert histograms.orientation_px is not None
    assert np.array_equal(patches.orientation_px, histograms.orientation_px)


def test_patches_have_zero_mean_and_unit_norm() -> None:
    descriptors = PixelPatch().extract(texture()).descriptors
    assert descriptors.shape[1] == SIDE**2
    np.testing.assert_allclose(np.linalg.norm(descriptors, axis=1), 1.0, atol=1e-5)
    np.testing.assert_allclose(descriptors.sum(axis=1), 0.0, atol=1e-4)


@pytest.mark.parametrize("turns", [0, 1, 2, 3])
def test_rows_run_along_the_orientation(turns: int) -> None:
    """In a picture that gets brighter by 1 per pixel to the right, patches with pixels of its size, turned."""
    picture = np.tile(np.arange(100, dtype=np.uint8), (100, 1))
    half = SIDE / 2
    orientation_px = np.array([[half, 0], [0, half], [-half, 0], [0, -half]], np.float32)[turns : turns + 1]
    patch = sample_patches(picture, np.array([[50.5, 50.5]], np.float32), orientation_px).reshape(SIDE, SIDE)
    steps = {0: (0, 1), 1: (-1, 0), 2: (0, -1), 3: (1, 0)}[turns]  # of a column downward, of a row
    np.testing.assert_allclose(np.diff(patch, axis=0), steps[0], atol=0.05)
    np.testing.assert_allclose(np.diff(patch, axis=1), steps[1], atol=0.05)
    assert patch.mean() == pytest.approx(50.5, abs=0.05)


def test_patches_are_invariant_to_rotation_and_scale() -> None:
    """Most keypoints that are detected again have a similar patch."""
    picture = texture()
    matrix = cv2.getRotationMatrix2D((125, 120), 35.0, 1.4)
    turned = cv2.warpAffine(picture, matrix, (250, 240))
    features, turned_features = PixelPatch().extract(picture, 300), PixelPatch().extract(turned, 600)
    positions = features.geometry @ matrix[:, :2].T + matrix[:, 2]
    distance = np.linalg.norm(positions[:, None] - turned_features.geometry, axis=2)
    rows = np.flatnonzero(distance.min(axis=1) < 0.7)
    assert len(rows) > 30
    matched = turned_features.descriptors[distance[rows].argmin(axis=1)]
    similarity = (features.descriptors[rows] * matched).sum(axis=1)
    assert np.median(similarity) > 0.9


@pytest.mark.parametrize("shape", [(1, 1), (40, 60)])
def test_extract_from_a_black_picture_is_empty(shape: tuple[int, int]) -> None:
    features = PixelPatch().extract(np.zeros(shape, np.uint8))
    assert features.descriptors.shape == (0, SIDE**2)


def test_patch_without_contrast_is_a_unit_vector(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("geoskill.features.patch.sample_patches", lambda *_: np.full((3, SIDE**2), 9.0, np.float32))
    monkeypatch.setattr(
        "geoskill.features.patch.distinct_keypoints",
        lambda *_: [cv2.KeyPoint(float(x), 5.0, 4.0, 0.0, 1.0) for x in (10, 20, 30)],
    )
    descriptors = PixelPatch().extract(texture()).descriptors
    np.testing.assert_array_equal(descriptors, np.eye(1, SIDE**2).repeat(3, axis=0))
