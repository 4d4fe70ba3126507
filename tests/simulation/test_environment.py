"""The room, and what passes between the camera and the scene."""

import mujoco
import numpy as np
import pytest

from geoskill.geometry.camera import PinholeCamera, project
from geoskill.geometry.poses import pose, transform
from geoskill.simulation.environment import (
    OCCLUDER_HALF_SIZE,
    OCCLUDER_DEPTH_RATIO,
    Occlusion,
    add_light,
    add_occluder,
    add_table,
    lamp_trajectory,
    occluder_trajectory,
)

# Looking down from 1 m; on the table a pixel is 2 mm wide.
ABOVE = pose((0.0, 0.0, 1.0), np.diag([1.0, -1.0, -1.0]))
LENS = PinholeCamera(641, 481, 500.0, np.eye(4))
# A square of 10 cm around the middle of the picture: columns 295 to 345.
OUTLINE = np.array([[x, y, 0.0] for x in (-0.05, 0.05) for y in (-0.05, 0.05)])


@pytest.mark.parametrize(("side", "covered_to"), [(-1.0, 295 + 0.8 * 50), (1.0, 345 - 0.8 * 50)])
def test_what_passes_covers_as_much_as_it_is_to(side: float, covered_to: float) -> None:
    frames = 101
    course = occluder_trajectory(
        np.repeat(ABOVE[None], frames, axis=0), LENS, OUTLINE, Occlusion(hidden=0.8, begin=0.2, end=0.8), side
    )
    view = PinholeCamera(641, 481, 500.0, ABOVE)
    edges = np.stack([transform(matrix, np.array([[-side * OCCLUDER_HALF_SIZE, 0.0, 0.0]]))[0] for matrix in course])
    pixels, depth = project(view, edges)
    np.testing.assert_allclose(depth, OCCLUDER_DEPTH_RATIO)
    # From the left, what is left of its near edge is hidden, down to the whole height of the picture.
    half_height_px = OCCLUDER_HALF_SIZE * 500 / OCCLUDER_DEPTH_RATIO
    assert half_height_px > 481 / 2
    assert pixels[50, 0] == pytest.approx(covered_to)
    away = pixels[[0, 20, 80, 100], 0]
    assert np.all(away < -1) if side < 0 else np.all(away > 641)
    # In, for a while there, and out: two thirds of its time it covers most.
    covers = np.abs(pixels[:, 0] - covered_to) < 1e-6
    assert 30 <= covers.sum() <= 45
    assert np.all(np.diff(np.flatnonzero(covers)) == 1)
    # It shows its front to the camera.
    assert all(matrix[:3, 2] @ ABOVE[:3, 2] == pytest.approx(-1) for matrix in course)


def test_it_follows_a_camera_that_moves() -> None:
    course = occluder_trajectory(
        np.stack([ABOVE, pose((0.1, 0.0, 0.0)) @ ABOVE]), LENS, OUTLINE, Occlusion(1.0, -1.0, 3.0), -1.0
    )
    for number, matrix in enumerate((ABOVE, pose((0.1, 0.0, 0.0)) @ ABOVE)):
        edge = transform(course[number], np.array([[OCCLUDER_HALF_SIZE, 0.0, 0.0]]))
        outline, _ = project(PinholeCamera(641, 481, 500.0, matrix), OUTLINE)
        pixels, _ = project(PinholeCamera(641, 481, 500.0, matrix), edge)
        assert pixels[0, 0] == pytest.approx(outline[:, 0].max())  # all is covered


def test_the_lamp_goes_most_of_the_way_round_over_the_table() -> None:
    for seed in range(20):
        places = lamp_trajectory(90, np.random.default_rng(seed))[:, :3, 3]
        assert np.ptp(places[:, 2]) == 0
        assert 0.3 < places[0, 2] < 1
        radius = np.linalg.norm(places[:, :2], axis=1)
        assert 0.2 < radius.min() <= radius.max() < 0.5
        assert 0.55 < np.ptp(np.unwrap(np.arctan2(places[:, 1], places[:, 0]))) / (2 * np.pi) < 0.95
        steps = np.linalg.norm(np.diff(places, axis=0), axis=1)
        assert steps.max() < 0.04  # about a meter a second


@pytest.mark.parametrize(("dark", "lights"), [(0.0, 2), (0.4, 3), (1.0, 1)])
def test_the_lights_of_the_room(dark: float, lights: int) -> None:
    spec = mujoco.MjSpec()
    add_light(spec, dark, np.random.default_rng(0))
    model = spec.compile()
    assert model.nlight == lights
    room = sum(float(model.light_diffuse[number, 0]) for number in range(lights) if model.light(number).name != "moved")
    assert room == pytest.approx((1 - dark) * 0.85, rel=0.06)
    assert (model.nmocap == 1) == (dark > 0)  # the lamp that is moved


def test_table_and_folder() -> None:
    tops = []
    for seed in (0, 0, 1):
        spec = mujoco.MjSpec()
        add_table(spec, np.random.default_rng(seed))
        add_occluder(spec, np.random.default_rng(seed))
        model = spec.compile()
        geom = model.body("table").geomadr[0]
        assert model.geom_pos[geom, 2] + model.geom_size[geom, 2] == pytest.approx(0)
        tops.append(model.tex_data.copy())
    np.testing.assert_array_equal(tops[0], tops[1])
    assert np.any(tops[0] != tops[2])
