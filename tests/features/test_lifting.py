"""Lifting: exact depth by hand, edges, holes, and the noise of a D435 by Monte Carlo."""

from collections.abc import Callable

import cv2
import numpy as np
import pytest
import torch
from torch import Tensor

from geoskill.features.lifting import lift, lift_lines, lift_points
from geoskill.geometry.depth_camera import DepthCamera
from geoskill.geometry.depth_picture import DepthPicture
from geoskill.geometry.primitives import NodeType
from geoskill.geometry.space import (
    coplanarity,
    line_to_line_in_space,
    lines_coplanarity,
    parallel_in_space,
    point_to_point_in_space,
)

WIDTH, HEIGHT = 640, 480
CAMERA = DepthCamera(659.0, 659.0, 319.5, 239.5)
# A table seen 50 degrees from above, 0.7 m away in the middle of the picture.
NORMAL = np.array([0.0, -np.cos(np.radians(50)), -np.sin(np.radians(50))])
PLANE = np.array([*NORMAL, -NORMAL[2] * 0.7])


def depth_of_plane(plane: np.ndarray = PLANE) -> np.ndarray:
    rows, columns = np.mgrid[:HEIGHT, :WIDTH]
    rays = CAMERA.back_project(np.stack([columns, rows], axis=-1).astype(np.float64), np.ones((HEIGHT, WIDTH)))
    return (-plane[3] / (rays @ plane[:3])).astype(np.float32)


def on_plane(pixels: np.ndarray) -> np.ndarray:
    rays = CAMERA.back_project(pixels, np.ones(len(pixels)))
    return rays * (-PLANE[3] / (rays @ PLANE[:3]))[:, None]


def test_point_is_lifted_to_its_place() -> None:
    pixels = np.array([[100.0, 90.0], [320.0, 240.0], [600.0, 400.0]])
    space, covariance = lift_points(pixels, DepthPicture(np.full((HEIGHT, WIDTH), 0.7, np.float32), CAMERA))
    np.testing.assert_allclose(space, CAMERA.back_project(pixels, np.full(3, 0.7)), atol=1e-7)
    lateral, along = 0.5 * 0.7 / 659, CAMERA.noise_per_m * 0.49
    # In the middle of the picture the axes are those of the pixel and of the depth.
    np.testing.assert_allclose(np.diag(covariance[1]) ** 0.5, [lateral, lateral, along], rtol=1e-3)


def test_point_belongs_to_what_is_in_front_and_needs_some_depth() -> None:
    depth_m = np.full((20, 30), 0.9, np.float32)
    depth_m[:10, :15] = 0.6
    picture = DepthPicture(depth_m, CAMERA)
    points = np.array([[14.0, 9.0], [15.0, 10.0], [17.0, 12.0], [0.0, 0.0]])
    np.testing.assert_allclose(lift_points(points, picture)[0][:, 2], [0.6, 0.9, 0.9, 0.6], atol=1e-6)
    np.testing.assert_allclose(lift_points(points[:1], picture)[0][0, 2], 0.6, atol=1e-6)
    depth_m[7:12, 12:17] = np.nan
    depth_m[7, 12:17] = 0.6
    assert np.isnan(lift_points(points[:1], picture)[0]).all()
    depth_m[8, 12] = 0.6
    np.testing.assert_allclose(lift_points(points[:1], picture)[0][0, 2], 0.6, atol=1e-6)
    assert np.isnan(lift_points(np.array([[-5.0, 3.0], [40.0, 3.0]]), picture)[0]).all()


def test_quantile_is_numpys() -> None:
    random = np.random.default_rng(0)
    depth_m = random.uniform(0.5, 1.0, (5, 5)).astype(np.float32)
    depth_m.ravel()[random.permutation(25)[:9]] = np.nan
    (space,), _ = lift_points(np.array([[2.0, 2.0]]), DepthPicture(depth_m, CAMERA))
    assert space[2] == pytest.approx(np.nanquantile(depth_m.astype(np.float64), 0.2))


def test_line_is_lifted_in_the_order_of_its_ends() -> None:
    segment = np.array([[250.0, 200.0, 390.0, 260.0]])
    picture = DepthPicture(depth_of_plane(), CAMERA)
    (space,), _ = lift_lines(segment, picture)
    expected = on_plane(segment.reshape(2, 2)).ravel()
    # The nearer side is 3 px closer to the camera, along a table at 50 degrees.
    np.testing.assert_allclose(space, expected, atol=4e-3)
    (backwards,), _ = lift_lines(segment[:, [2, 3, 0, 1]], picture)
    np.testing.assert_allclose(backwards, space[[3, 4, 5, 0, 1, 2]], atol=1e-9)


def test_line_on_the_edge_of_a_box_is_that_of_the_box() -> None:
    depth_m = np.full((HEIGHT, WIDTH), 0.8, np.float32)
    depth_m[150:300, 200:400] = 0.7
    space, _ = lift_lines(np.array([[200.0, 149.5, 400.0, 149.5]]), DepthPicture(depth_m, CAMERA))
    np.testing.assert_allclose(space[0, [2, 5]], 0.7, atol=1e-6)
    for hole in (slice(200, 300), slice(330, 400)):  # half of it, then eight in ten
        depth_m[:, hole] = np.nan
    assert np.isnan(lift_lines(np.array([[200.0, 149.5, 400.0, 149.5]]), DepthPicture(depth_m, CAMERA))[0]).all()


def test_outliers_do_not_bend_a_line() -> None:
    depth_m = np.full((HEIGHT, WIDTH), 0.7, np.float32)
    depth_m[:, 300:340] = 0.5  # a cable before it
    space, _ = lift_lines(np.array([[200.0, 150.0, 400.0, 150.0]]), DepthPicture(depth_m, CAMERA))
    np.testing.assert_allclose(space[0, [2, 5]], 0.7, atol=1e-6)


@pytest.mark.parametrize("node_type", NodeType)
def test_nothing_is_lifted_to_nothing(node_type: NodeType) -> None:
    picture = DepthPicture(np.full((20, 30), 0.7, np.float32), CAMERA)
    space, covariance = lift(node_type, np.zeros((0, node_type.geometry_dim), np.float32), picture)
    assert space.shape == (0, node_type.space_dim)
    assert covariance.shape == (0, node_type.space_dim, node_type.space_dim)


def noisy(depth_m: np.ndarray, random: np.random.Generator) -> DepthPicture:
    """Depth of a D435: noise of s_z, smoothed over 5 px."""
    noise = cv2.GaussianBlur(random.normal(size=depth_m.shape), (0, 0), 5 / 2.355)
    noisy_m = depth_m + CAMERA.depth_std_m(depth_m) * noise / noise.std()
    return DepthPicture(noisy_m.astype(np.float32), CAMERA)


def monte_carlo(pixels: np.ndarray, node_type: NodeType, draws: int = 200) -> tuple[list[np.ndarray], np.ndarray]:
    """Features on the table, each detected with 0.5 px and lifted, ``[draws, s]`` each; and their covariance."""
    random = np.random.default_rng(0)
    clean = depth_of_plane()
    lifted = []
    for _ in range(draws):
        detected = (pixels + random.normal(0, 0.5, pixels.shape)).astype(np.float32)
        lifted.append(lift(node_type, detected, noisy(clean, random))[0])
    _, covariance = lift(node_type, pixels.astype(np.float32), DepthPicture(clean, CAMERA))
    return list(np.stack(lifted, axis=1).astype(np.float64)), covariance


def pixels_at(offsets_mm: np.ndarray) -> np.ndarray:
    """Pixels of places on the table, in millimeters right and up from the middle of the picture."""
    up = np.cross(NORMAL, [1.0, 0.0, 0.0])
    places = np.array([0.0, 0.0, 0.7]) + offsets_mm[:, :1] / 1e3 * [1, 0, 0] + offsets_mm[:, 1:] / 1e3 * up
    return CAMERA.project(places)


def std_of(error: Callable[..., Tensor], *nodes: np.ndarray) -> np.ndarray:
    return error(*(torch.from_numpy(rows) for rows in nodes)).numpy().std(axis=0)


POINTS = np.array([[-30.0, -30.0], [30.0, -30.0], [30.0, 30.0], [-30.0, 30.0]])
LINES = np.array([[-50.0, -20.0, 50.0, -20.0], [-50.0, 20.0, 50.0, 20.0], [0.0, -50.0, 0.0, 50.0]])


@pytest.mark.slow
def test_noise_of_points_is_that_of_the_design() -> None:
    (a, b, c, d), covariance = monte_carlo(pixels_at(POINTS), NodeType.POINT)
    error = 1e3 * std_of(point_to_point_in_space, a, b)
    np.testing.assert_allclose(error, [0.8, 0.8, 2.5], rtol=0.2)
    assert 1e3 * std_of(lambda *x: coplanarity(torch.stack(x)), a, b, c, d)[0] == pytest.approx(2.8, rel=0.2)
    predicted = 1e3 * np.sqrt(np.diag(covariance[0] + covariance[1]))
    np.testing.assert_allclose(error, predicted, rtol=0.2)


@pytest.mark.slow
def test_noise_of_lines_is_that_of_the_design() -> None:
    (a, b, c), covariance = monte_carlo(pixels_at(LINES.reshape(-1, 2)).reshape(-1, 4), NodeType.LINE)
    first, second, crossing = (torch.from_numpy(rows) for rows in (a, b, c))
    error = line_to_line_in_space(first, second)
    assert 1e3 * float((error - error.mean(dim=0)).norm(dim=1).mean()) == pytest.approx(1.4, rel=0.2)
    assert np.degrees(float(parallel_in_space(first, second).norm(dim=1).mean())) == pytest.approx(1.2, rel=0.2)
    assert 1e3 * float(lines_coplanarity(first, crossing).std()) == pytest.approx(0.7, rel=0.2)
    # Depths along a line are not quite independent.
    np.testing.assert_allclose(a.std(axis=0), np.sqrt(np.diag(covariance[0])), rtol=0.4)
