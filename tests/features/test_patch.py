"""Patches: of the keypoints that SIFT has, in their direction and size."""

import cv2
import numpy as np
import pytest

from geoskill.features.patch import SIDE, Patch, patches_along
from geoskill.features.sift import Sift
from geoskill.geometry.primitives import NodeType


def texture(height: int = 240, width: int = 250) -> np.ndarray:
    noise = np.random.default_rng(0).uniform(0, 255, (height, width)).astype(np.float32)
    smooth = cv2.GaussianBlur(noise, (0, 0), 2.0)
    return cv2.normalize(smooth, None, 0, 255, cv2.NORM_MINMAX).astype(np.uint8)


def test_keypoints_are_those_of_sift() -> None:
    patches, histograms = Patch().extract(texture(), 50), Sift().extract(texture(), 50)
    assert patches.node_type is NodeType.POINT
    assert np.array_equal(patches.geometry, histograms.geometry)
    assert np.array_equal(patches.strength, histograms.strength)
    assert patches.arms is not None
    assert histograms.arms is not None
    assert np.array_equal(patches.arms, histograms.arms)


def test_zero_mean_and_unit_norm() -> None:
    descriptors = Patch().extract(texture()).descriptors
    assert descriptors.shape[1] == SIDE**2
    np.testing.assert_allclose(np.linalg.norm(descriptors, axis=1), 1.0, atol=1e-5)
    np.testing.assert_allclose(descriptors.sum(axis=1), 0.0, atol=1e-4)


@pytest.mark.parametrize("turns", [0, 1, 2, 3])
def test_pixels_lie_along_the_arm(turns: int) -> None:
    """Of a picture that grows by 1 a pixel to the right, patches of pixels of its own size, their rows turned."""
    picture = np.tile(np.arange(100, dtype=np.uint8), (100, 1))
    half = SIDE / 2
    arm = np.array([[half, 0], [0, half], [-half, 0], [0, -half]], np.float32)[turns : turns + 1]
    patch = patches_along(picture, np.array([[50.5, 50.5]], np.float32), arm).reshape(SIDE, SIDE)
    steps = {0: (0, 1), 1: (-1, 0), 2: (0, -1), 3: (1, 0)}[turns]  # down a column, along a row
    np.testing.assert_allclose(np.diff(patch, axis=0), steps[0], atol=0.05)
    np.testing.assert_allclose(np.diff(patch, axis=1), steps[1], atol=0.05)
    assert patch.mean() == pytest.approx(50.5, abs=0.05)


def test_a_turned_and_enlarged_picture_has_the_same_patches() -> None:
    """Of keypoints that are found again, most look as they did."""
    picture = texture()
    matrix = cv2.getRotationMatrix2D((125, 120), 35.0, 1.4)
    turned = cv2.warpAffine(picture, matrix, (250, 240))
    one, other = Patch().extract(picture, 300), Patch().extract(turned, 600)
    places = one.geometry @ matrix[:, :2].T + matrix[:, 2]
    apart = np.linalg.norm(places[:, None] - other.geometry, axis=2)
    found = np.flatnonzero(apart.min(axis=1) < 0.7)
    assert len(found) > 30
    likeness = (one.descriptors[found] * other.descriptors[apart[found].argmin(axis=1)]).sum(axis=1)
    assert np.median(likeness) > 0.9


@pytest.mark.parametrize("shape", [(1, 1), (40, 60)])
def test_a_black_picture_has_no_feature_but_the_right_widths(shape: tuple[int, int]) -> None:
    features = Patch().extract(np.zeros(shape, np.uint8))
    assert features.descriptors.shape == (0, SIDE**2)


def test_the_least_patch_without_contrast_is_still_a_descriptor(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("geoskill.features.patch.patches_along", lambda *_: np.full((3, SIDE**2), 9.0, np.float32))
    monkeypatch.setattr(
        "geoskill.features.patch.distinct_keypoints",
        lambda *_: [cv2.KeyPoint(float(x), 5.0, 4.0, 0.0, 1.0) for x in (10, 20, 30)],
    )
    descriptors = Patch().extract(texture()).descriptors
    np.testing.assert_array_equal(descriptors, np.eye(1, SIDE**2).repeat(3, axis=0))
