"""The environment: table, lamps and occluder."""

import mujoco
import numpy as np
import pytest

from geoskill.geometry.camera import PinholeCamera, project
from geoskill.geometry.poses import pose, transform
from geoskill.simulation.environment import (
    OCCLUDER_DEPTH_RATIO,
    OCCLUDER_HALF_SIZE,
    Occlusion,
    add_light,
    add_occluder,
    add_table,
    lamp_trajectory,
    occluder_trajectory,
)

# Looks down from 1 m; on the table a pixel is 2 mm wide.
ABOVE = pose((0.0, 0.0, 1.0), np.diag([1.0, -1.0, -1.0]))
INTRINSICS = PinholeCamera(641, 481, 500.0, np.eye(4))
# A square of 10 cm around the center of the image: columns 295 to 345.
OUTLINE = np.array([[x, y, 0.0] for x in (-0.05, 0.05) for y in (-0.05, 0.05)])


@pytest.mark.parametrize(("side", "covered_to"), [(-1.0, 295 + 0.8 * 50), (1.0, 345 - 0.8 * 50)])
def test_occluder_covers_the_share_it_should(side: float, covered_to: float) -> None:
    frames = 101
    trajectory = occluder_trajectory(
        np.repeat(ABOVE[None], frames, axis=0), INTRINSICS, OUTLINE, Occlusion(coverage=0.8, begin=0.2, end=0.8), side
    )
    view = PinholeCamera(641, 481, 500.0, ABOVE)
    edges = np.stack(
        [transform(matrix, np.array([[-side * OCCLUDER_HALF_SIZE, 0.0, 0.0]]))[0] for matrix in trajectory]
    )
    pixels, depth = project(view, edges)
    np.testing.assert_allclose(depth, OCCLUDER_DEPTH_RATIO)
    # It is higher than the image, so everything beside its leading edge is hidden.
    half_height_px = OCCLUDER_HALF_SIZE * 500 / OCCLUDER_DEPTH_RATIO
    assert half_height_px > 481 / 2
    assert pixels[50, 0] == pytest.approx(covered_to)
    away = pixels[[0, 20, 80, 100], 0]
    assert np.all(away < -1) if side < 0 else np.all(away > 641)
    # It covers most for two thirds of its time, without interruption.
    covers = np.abs(pixels[:, 0] - covered_to) < 1e-6
    assert 30 <= covers.sum() <= 45
    assert np.all(np.diff(np.flatnonzero(covers)) == 1)
    # Its front faces the camera.
    assert all(matrix[:3, 2] @ ABOVE[:3, 2] == pytest.approx(-1) for matrix in trajectory)


def test_occluder_follows_a_moving_camera() -> None:
    trajectory = occluder_trajectory(
        np.stack([ABOVE, pose((0.1, 0.0, 0.0)) @ ABOVE]), INTRINSICS, OUTLINE, Occlusion(1.0, -1.0, 3.0), -1.0
    )
    for frame, matrix in enumerate((ABOVE, pose((0.1, 0.0, 0.0)) @ ABOVE)):
        edge = transform(trajectory[frame], np.array([[OCCLUDER_HALF_SIZE, 0.0, 0.0]]))
        outline, _ = project(PinholeCamera(641, 481, 500.0, matrix), OUTLINE)
        pixels, _ = project(PinholeCamera(641, 481, 500.0, matrix), edge)
        assert pixels[0, 0] == pytest.approx(outline[:, 0].max())  # everything is covered


def test_lamp_trajectory_is_an_arc_above_the_table() -> None:
    for seed in range(20):
        positions = lamp_trajectory(90, np.random.default_rng(seed))[:, :3, 3]
        assert np.ptp(positions[:, 2]) == 0
        assert 0.3 < positions[0, 2] < 1
        radius = np.linalg.norm(positions[:, :2], axis=1)
        assert 0.2 < radius.min() <= radius.max() < 0.5
        assert 0.55 < np.ptp(np.unwrap(np.arctan2(positions[:, 1], positions[:, 0]))) / (2 * np.pi) < 0.95
        steps = np.linalg.norm(np.diff(positions, axis=0), axis=1)
        assert steps.max() < 0.04  # about a meter a second


@pytest.mark.parametrize(("darkness", "lights"), [(0.0, 2), (0.4, 3), (1.0, 1)])
def test_light_of_usual_and_dark_rooms(darkness: float, lights: int) -> None:
    spec = mujoco.MjSpec()
    add_light(spec, darkness, np.random.default_rng(0))
    model = spec.compile()
    assert model.nlight == lights
    room = sum(float(model.light_diffuse[index, 0]) for index in range(lights) if model.light(index).name != "moved")
    assert room == pytest.approx((1 - darkness) * 0.85, rel=0.06)
    assert (model.nmocap == 1) == (darkness > 0)  # the moving lamp


def test_table_top_is_at_zero_and_appearance_depends_on_the_seed() -> None:
    textures = []
    for seed in (0, 0, 1):
        spec = mujoco.MjSpec()
        add_table(spec, np.random.default_rng(seed))
        add_occluder(spec, np.random.default_rng(seed))
        model = spec.compile()
        geom = model.body("table").geomadr[0]
        assert model.geom_pos[geom, 2] + model.geom_size[geom, 2] == pytest.approx(0)
        textures.append(model.tex_data.copy())
    np.testing.assert_array_equal(textures[0], textures[1])
    assert np.any(textures[0] != textures[2])
