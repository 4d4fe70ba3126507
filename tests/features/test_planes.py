"""Planes of depth: a box on a table by hand, and their noise with a D435."""

import cv2
import numpy as np
import pytest

from geoskill.features.lifting import lift_planes, lift_points
from geoskill.features.pipeline import FeaturePipeline
from geoskill.features.planes import Planes, find_planes
from geoskill.geometry.depth_camera import DepthCamera
from geoskill.geometry.depth_picture import DepthPicture
from geoskill.testing import check_extractor

WIDTH, HEIGHT = 640, 480
CAMERA = DepthCamera(659.0, 659.0, 319.5, 239.5)
TILT = np.radians(50)
# A table seen 50 degrees from above, 0.7 m away in the middle of the picture; and the top of a box, 36 mm above it.
TABLE = np.array([0.0, -np.cos(TILT), -np.sin(TILT), np.sin(TILT) * 0.7])
TOP = TABLE - np.array([0.0, 0.0, 0.0, 0.036])
BOX = np.s_[180:300, 250:400]


def depth_of(plane: np.ndarray) -> np.ndarray:
    rows, columns = np.mgrid[:HEIGHT, :WIDTH]
    rays = CAMERA.back_project(np.stack([columns, rows], axis=-1).astype(np.float64), np.ones((HEIGHT, WIDTH)))
    return (-plane[3] / (rays @ plane[:3])).astype(np.float32)


def scene() -> np.ndarray:
    depth_m = depth_of(TABLE)
    depth_m[BOX] = depth_of(TOP)[BOX]
    return depth_m


def noisy(depth_m: np.ndarray, seed: int = 0) -> DepthPicture:
    noise = cv2.GaussianBlur(np.random.default_rng(seed).normal(size=depth_m.shape), (0, 0), 5 / 2.355)
    return DepthPicture((depth_m + CAMERA.depth_std_m(depth_m) * noise / noise.std()).astype(np.float32), CAMERA)


def test_planes_of_a_box_on_a_table_are_found_the_largest_first() -> None:
    found = find_planes(noisy(scene()))
    assert len(found) == 2
    for (_, plane, covariance), expected in zip(found, (TABLE, TOP), strict=True):
        np.testing.assert_allclose(plane, expected, atol=5e-3)
        assert plane[:3] @ plane[:3] == pytest.approx(1.0)
        std = np.sqrt(np.diag(covariance))
        assert (np.abs(plane - expected) < 5 * std + 1e-4).all()
    table, top = (mask for mask, _, _ in found)
    assert not (table & top).any()
    assert top[46:74, 64:99].mean() > 0.98


def test_two_surfaces_of_one_plane_are_two_features() -> None:
    depth_m = depth_of(TABLE)
    depth_m[:, 300:340] = depth_of(TOP)[:, 300:340]  # a bar on it
    planes = [plane for _, plane, _ in find_planes(DepthPicture(depth_m, CAMERA))]
    assert len(planes) == 3
    assert sum(np.allclose(plane, TABLE, atol=1e-4) for plane in planes) == 2


def test_depth_without_planes_has_none() -> None:
    random = np.random.default_rng(0)
    for depth_m in (
        np.full((HEIGHT, WIDTH), np.nan),
        random.uniform(0.5, 1.5, (HEIGHT, WIDTH)),
        np.where(np.indices((HEIGHT, WIDTH)).max(axis=0) < 15, 0.7, np.nan),  # fewer than 400 pixels
    ):
        assert find_planes(DepthPicture(depth_m.astype(np.float32), CAMERA)) == []


def test_extractor_gives_outlines_and_descriptors_of_what_is_on_a_plane() -> None:
    random = np.random.default_rng(0)
    picture = np.full((HEIGHT, WIDTH, 3), 120, np.uint8)
    tiles = np.kron(random.integers(30, 226, (8, 10, 3)), np.ones((15, 15, 1)))
    picture[BOX] = tiles
    pipeline = FeaturePipeline(Planes(), max_features=10, min_side=480, color=8.0, in_space=True)
    features = pipeline.extract(picture, noisy(scene()))
    assert features.space.shape == (2, 4)
    corners = features.geometry[1].reshape(4, 2)
    np.testing.assert_allclose(corners.min(axis=0), [250, 180], atol=5)
    np.testing.assert_allclose(corners.max(axis=0), [399, 299], atol=5)
    assert features.descriptors[0] @ features.descriptors[1] < 0.9
    assert len(Planes().extract(picture[..., 0])) == 0
    # Fitted again within the outline, as where flow leads it.
    space, covariance = lift_planes(features.geometry, noisy(scene(), 1))
    np.testing.assert_allclose(space, features.space, atol=0.02)
    assert np.isfinite(covariance).all()


@pytest.mark.slow
def test_noise_of_a_point_over_a_plane_is_no_more_than_that_of_the_design() -> None:
    """A point on the table, and the table as it is found; the design expects 1.6 mm of depths that are not averaged."""
    distances = []
    pixel = np.array([[319.5, 350.0]])
    for seed in range(60):
        picture = noisy(scene(), seed)
        shaken = pixel + np.random.default_rng(seed).normal(0, 0.5, (1, 2))
        (point,), _ = lift_points(shaken, picture)
        (_, plane, _), *_ = find_planes(picture)
        distances.append(plane[:3] @ point + plane[3])
    assert 0.6 < 1e3 * np.std(distances) < 1.2 * 1.6


@pytest.mark.slow
def test_covariance_of_a_small_plane_is_that_of_its_noise() -> None:
    """Beside the box, where the plane is known by its tilt; both as it is found, and as fitted within an outline."""
    place = np.array([0.10, 0.0, 0.0])
    place[2] = -(TOP[:2] @ place[:2] + TOP[3]) / TOP[2]
    outline = np.array([[250, 180, 399, 180, 399, 299, 250, 299]], np.float32)
    distances, stds = [], []
    for seed in range(40):
        picture = noisy(scene(), seed)
        _, (_, plane, covariance) = find_planes(picture)
        (lifted,), (lifted_covariance,) = lift_planes(outline, picture)
        for own, own_covariance in ((plane, covariance), (lifted, lifted_covariance)):
            distances.append(own[:3] @ place + own[3])
            stds.append(np.sqrt(np.append(place, 1) @ own_covariance @ np.append(place, 1)))
    for start in range(2):
        found, told = np.array(distances[start::2]), np.array(stds[start::2])
        assert 0.7 < found.std() / told.mean() < 1.4
        assert 1e3 * found.std() < 1.5


def test_planes_keep_the_contract_of_extractors() -> None:
    check_extractor(Planes)
