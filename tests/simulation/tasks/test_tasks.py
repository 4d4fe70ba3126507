"""What every task promises of its scene, and the goals by hand; nothing is rendered."""

from collections.abc import Callable

import mujoco
import numpy as np
import pytest

from geoskill.geometry.poses import inverse, table_pose, transform
from geoskill.simulation.roles import SceneRole
from geoskill.simulation.tasks import folding, insertion, screw, sorting
from geoskill.simulation.tasks.task import RolePart, PlanarPose, Task, TaskScene

TASKS = ["sorting", "insertion", "folding", "screw"]
MIDDLE = PlanarPose(0.0, 0.0, 0.0)


def build(
    task: Task, appearance_rng: int = 0, episode_rng: int = 0, target: PlanarPose = MIDDLE, start: PlanarPose = MIDDLE
) -> tuple[mujoco.MjModel, TaskScene]:
    spec = mujoco.MjSpec()
    scene = task.build(spec, target, start, np.random.default_rng(appearance_rng), np.random.default_rng(episode_rng))
    return spec.compile(), scene


def poses(model: mujoco.MjModel) -> dict[str, np.ndarray]:
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    found = {}
    for number in range(model.nbody):
        matrix = np.eye(4)
        matrix[:3, :3], matrix[:3, 3] = data.xmat[number].reshape(3, 3), data.xpos[number]
        found[model.body(number).name] = matrix
    return found


@pytest.mark.parametrize("name", TASKS)
def test_scene(task_called: Callable[[str], Task], name: str) -> None:
    task = task_called(name)
    assert task.name == name
    model, scene = build(task)
    there = poses(model)
    for matrix in (scene.start, scene.goal):
        np.testing.assert_allclose(matrix[:3, :3].T @ matrix[:3, :3], np.eye(3), atol=1e-9)
        assert np.abs(matrix[:2, 3]).max() < 0.3  # within the picture
        assert matrix[2, 3] > 0
    assert np.linalg.norm(scene.start[:3, 3] - scene.goal[:3, 3]) > 0.1
    roles = {part.role for part in scene.roles}
    assert roles == {SceneRole.OBJECT, SceneRole.TARGET}
    assert all(part.body in there for part in scene.roles)
    assert scene.approach[2] > 0
    assert (scene.cloth is None) == (name != "folding")
    # Nothing collides: things are led.
    assert not np.any(model.geom_contype | model.geom_conaffinity)


@pytest.mark.parametrize("name", TASKS)
def test_looks_stay_and_takes_differ(task_called: Callable[[str], Task], name: str) -> None:
    task = task_called(name)
    model, scene = build(task)
    again, same = build(task)
    other_take, otherwise_held = build(task, take=1)
    other_looks, _ = build(task, looks=1)
    np.testing.assert_array_equal(model.tex_data, again.tex_data)
    np.testing.assert_array_equal(scene.grip.pose, same.grip.pose)
    # What is drawn for a take does not change what things look like, by which they are recognized.
    np.testing.assert_array_equal(model.tex_data, other_take.tex_data)
    np.testing.assert_array_equal(model.geom_rgba, other_take.geom_rgba)
    assert np.any(scene.grip.pose != otherwise_held.grip.pose)
    assert model.tex_data.shape != other_looks.tex_data.shape or np.any(model.tex_data != other_looks.tex_data)


@pytest.mark.parametrize("name", TASKS)
def test_the_goal_goes_with_the_target(task_called: Callable[[str], Task], name: str) -> None:
    task = task_called(name)
    place = PlanarPose(0.03, -0.02, 0.4)
    _, usual = build(task)
    _, moved = build(task, target=place)
    shift = moved.goal @ inverse(usual.goal)
    # All that is fixed to the target makes one movement about the vertical.
    np.testing.assert_allclose(shift[:3, :3], table_pose(0, 0, 0.4)[:3, :3], atol=1e-9)
    assert shift[2, 3] == pytest.approx(0)
    if name != "folding":  # both ends are of one cloth
        np.testing.assert_array_equal(moved.start, usual.start)
        _, later = build(task, start=place)
        np.testing.assert_allclose(later.start[:2, 3] - usual.start[:2, 3], [0.03, -0.02], atol=1e-9)
        np.testing.assert_array_equal(later.goal, usual.goal)


@pytest.mark.parametrize("looks", range(4))
def test_the_box_comes_to_stand_on_its_tile(appearance_rng: int) -> None:
    model, scene = build(sorting.Sorting(), appearance_rng, target=PlanarPose(0.02, 0.01, 0.3))
    on_tile = inverse(poses(model)[sorting.TARGET]) @ scene.goal
    # The tile is 2 mm thick, and its frame below.
    np.testing.assert_allclose(on_tile[:3, 3], [0, 0, 0.002 + sorting.HALF_BOX[2]], atol=1e-9)
    np.testing.assert_allclose(on_tile[:3, :3], np.eye(3), atol=1e-9)
    tiles = [name for name in poses(model) if name == sorting.TARGET or name.startswith("distractor")]
    assert len(tiles) == 6
    # What is to be hidden is the tile up to the table's side of the box.
    corners = transform(on_tile, scene.extent)
    np.testing.assert_allclose(np.abs(corners[:, :2]), sorting.HALF_TILE, atol=1e-9)
    np.testing.assert_allclose(corners[:, 2], 0.002, atol=1e-9)


def test_the_block_comes_to_lie_in_the_slot() -> None:
    model, scene = build(insertion.Insertion())
    half_x, half_y, half_z = insertion.HALF_BLOCK
    in_holder = inverse(poses(model)[insertion.TARGET]) @ scene.goal
    corners = transform(in_holder, np.array([[-half_x, -half_y, -half_z], [half_x, half_y, half_z]]))
    assert np.abs(corners[:, 0]).max() <= insertion.HALF_SLOT  # between the cheeks
    assert corners[0, 1] == pytest.approx(-insertion.HALF_HOLDER[1] + insertion.STOP + insertion.GAP)  # behind the stop
    np.testing.assert_allclose(corners[:, 2], [insertion.FLOOR, insertion.TOP], atol=1e-9)  # flush with the top
    np.testing.assert_allclose(in_holder[:3, :3], np.eye(3), atol=1e-9)


@pytest.mark.parametrize("looks", range(4))
def test_the_tip_comes_into_a_hole(appearance_rng: int) -> None:
    model, scene = build(screw.Screw(), appearance_rng)
    in_plate = inverse(poses(model)[screw.TARGET]) @ scene.goal
    x, y, z = in_plate[:3, 3]
    assert z == pytest.approx(2 * screw.HALF_PLATE[2] - screw.DEPTH)
    assert x / screw.PITCH in (pytest.approx(-1), pytest.approx(0, abs=1e-9), pytest.approx(1))
    assert abs(y) == pytest.approx(screw.PITCH / 2)
    np.testing.assert_allclose(in_plate[:3, 2], [0, 0, 1], atol=1e-9)  # upright


def test_the_end_of_the_cloth_is_the_mirror_image_of_its_mark() -> None:
    _, scene = build(folding.Folding())
    end, mark = scene.roles
    # Folded at the crease, a point of the end comes to lie as far on the other side of it.
    assert end.lower[0] == pytest.approx(2 * folding.CREASE - mark.upper[0])
    assert 2 * folding.CREASE - folding.HALF[0] == pytest.approx(folding.LANDING)
    assert mark == RolePart(folding.NAME, SceneRole.TARGET, mark.lower, mark.upper)
    assert -folding.HALF[0] < mark.lower[0] < folding.LANDING < mark.upper[0] < folding.CREASE
