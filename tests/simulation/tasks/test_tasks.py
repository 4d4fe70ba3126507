"""Contract of the tasks' scenes, and goals computed by hand; nothing is rendered."""

from collections.abc import Callable

import mujoco
import numpy as np
import pytest

from geoskill.geometry.poses import inverse, table_pose, transform
from geoskill.simulation.roles import SceneRole
from geoskill.simulation.tasks import flush, folding, insertion, ring, screw, sorting
from geoskill.simulation.tasks.task import PlanarPose, RolePart, Task, TaskScene

TASKS = ["sorting", "insertion", "folding", "screw", "flush", "ring"]
CENTER = PlanarPose(0.0, 0.0, 0.0)


def build(
    task: Task,
    appearance_seed: int = 0,
    episode_seed: int = 0,
    target: PlanarPose = CENTER,
    start: PlanarPose = CENTER,
) -> tuple[mujoco.MjModel, TaskScene]:
    spec = mujoco.MjSpec()
    scene = task.build(spec, target, start, np.random.default_rng(appearance_seed), np.random.default_rng(episode_seed))
    return spec.compile(), scene


def body_poses(model: mujoco.MjModel) -> dict[str, np.ndarray]:
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    poses = {}
    for body_id in range(model.nbody):
        matrix = np.eye(4)
        matrix[:3, :3], matrix[:3, 3] = data.xmat[body_id].reshape(3, 3), data.xpos[body_id]
        poses[model.body(body_id).name] = matrix
    return poses


@pytest.mark.parametrize("name", TASKS)
def test_task_name_is_a_class_variable_equal_to_the_module_name(task_named: Callable[[str], Task], name: str) -> None:
    task_class = type(task_named(name))
    assert vars(task_class)["name"] == name
    assert task_class.__module__.rsplit(".", 1)[1] == name


@pytest.mark.parametrize("name", TASKS)
def test_scene_has_roles_and_a_path_and_nothing_collides(task_named: Callable[[str], Task], name: str) -> None:
    model, scene = build(task_named(name))
    poses = body_poses(model)
    for matrix in (scene.start, scene.goal):
        np.testing.assert_allclose(matrix[:3, :3].T @ matrix[:3, :3], np.eye(3), atol=1e-9)
        assert np.abs(matrix[:2, 3]).max() < 0.3  # within the image
        assert matrix[2, 3] > 0
    assert np.linalg.norm(scene.start[:3, 3] - scene.goal[:3, 3]) > 0.1
    roles = {part.role for part in scene.roles}
    assert roles == {SceneRole.OBJECT, SceneRole.TARGET}
    assert all(part.body in poses for part in scene.roles)
    assert scene.approach[2] > 0
    assert (scene.cloth is None) == (name != "folding")
    # Nothing collides: bodies follow scripted paths.
    assert not np.any(model.geom_contype | model.geom_conaffinity)


@pytest.mark.slow
@pytest.mark.parametrize("name", TASKS)
def test_appearance_does_not_depend_on_the_episode(task_named: Callable[[str], Task], name: str) -> None:
    task = task_named(name)
    model, scene = build(task)
    again, same = build(task)
    other_episode, held_elsewhere = build(task, episode_seed=1)
    other_appearance, _ = build(task, appearance_seed=1)
    np.testing.assert_array_equal(model.tex_data, again.tex_data)
    np.testing.assert_array_equal(scene.grip.pose, same.grip.pose)
    # Draws for an episode do not change the appearance, by which things are recognized.
    np.testing.assert_array_equal(model.tex_data, other_episode.tex_data)
    np.testing.assert_array_equal(model.geom_rgba, other_episode.geom_rgba)
    assert np.any(scene.grip.pose != held_elsewhere.grip.pose)
    assert model.tex_data.shape != other_appearance.tex_data.shape or np.any(
        model.tex_data != other_appearance.tex_data
    )


@pytest.mark.slow
@pytest.mark.parametrize("name", TASKS)
def test_goal_moves_with_the_target(task_named: Callable[[str], Task], name: str) -> None:
    task = task_named(name)
    displacement = PlanarPose(0.03, -0.02, 0.4)
    _, usual = build(task)
    _, moved = build(task, target=displacement)
    shift = moved.goal @ inverse(usual.goal)
    # Everything that is fixed to the target makes the same turn about the vertical.
    np.testing.assert_allclose(shift[:3, :3], table_pose(0, 0, 0.4)[:3, :3], atol=1e-9)
    assert shift[2, 3] == pytest.approx(0)
    if name != "folding":  # start and target are on one cloth
        np.testing.assert_array_equal(moved.start, usual.start)
        _, later = build(task, start=displacement)
        np.testing.assert_allclose(later.start[:2, 3] - usual.start[:2, 3], [0.03, -0.02], atol=1e-9)
        np.testing.assert_array_equal(later.goal, usual.goal)


@pytest.mark.parametrize("appearance_seed", range(4))
def test_sorting_goal_is_on_the_matching_tile(appearance_seed: int) -> None:
    model, scene = build(sorting.Sorting(), appearance_seed, target=PlanarPose(0.02, 0.01, 0.3))
    on_tile = inverse(body_poses(model)[sorting.TARGET]) @ scene.goal
    # The tile is 2 mm thick, with its frame at the bottom.
    np.testing.assert_allclose(on_tile[:3, 3], [0, 0, 0.002 + sorting.HALF_BOX[2]], atol=1e-9)
    np.testing.assert_allclose(on_tile[:3, :3], np.eye(3), atol=1e-9)
    tiles = [name for name in body_poses(model) if name == sorting.TARGET or name.startswith("distractor")]
    assert len(tiles) == 6
    # The extent to be hidden is the top of the tile.
    corners = transform(on_tile, scene.extent)
    np.testing.assert_allclose(np.abs(corners[:, :2]), sorting.HALF_TILE, atol=1e-9)
    np.testing.assert_allclose(corners[:, 2], 0.002, atol=1e-9)


def test_insertion_goal_is_in_the_slot() -> None:
    model, scene = build(insertion.Insertion())
    half_x, half_y, half_z = insertion.HALF_BLOCK
    in_holder = inverse(body_poses(model)[insertion.TARGET]) @ scene.goal
    corners = transform(in_holder, np.array([[-half_x, -half_y, -half_z], [half_x, half_y, half_z]]))
    assert np.abs(corners[:, 0]).max() <= insertion.HALF_SLOT  # between the cheeks
    assert corners[0, 1] == pytest.approx(-insertion.HALF_HOLDER[1] + insertion.STOP + insertion.GAP)  # behind the stop
    np.testing.assert_allclose(corners[:, 2], [insertion.FLOOR, insertion.TOP], atol=1e-9)  # flush with the top
    np.testing.assert_allclose(in_holder[:3, :3], np.eye(3), atol=1e-9)


@pytest.mark.parametrize("appearance_seed", range(4))
def test_screw_goal_is_in_a_hole(appearance_seed: int) -> None:
    model, scene = build(screw.Screw(), appearance_seed)
    in_plate = inverse(body_poses(model)[screw.TARGET]) @ scene.goal
    x, y, z = in_plate[:3, 3]
    assert z == pytest.approx(2 * screw.HALF_PLATE[2] - screw.DEPTH)
    assert x / screw.PITCH in (pytest.approx(-1), pytest.approx(0, abs=1e-9), pytest.approx(1))
    assert abs(y) == pytest.approx(screw.PITCH / 2)
    np.testing.assert_allclose(in_plate[:3, 2], [0, 0, 1], atol=1e-9)  # upright


def test_folding_roles_are_mirror_images_about_the_crease() -> None:
    _, scene = build(folding.Folding())
    end, mark = scene.roles
    # Folding mirrors the end's points about the crease.
    assert end.lower[0] == pytest.approx(2 * folding.CREASE - mark.upper[0])
    assert 2 * folding.CREASE - folding.HALF[0] == pytest.approx(folding.LANDING)
    assert mark == RolePart(folding.NAME, SceneRole.TARGET, mark.lower, mark.upper)
    assert -folding.HALF[0] < mark.lower[0] < folding.LANDING < mark.upper[0] < folding.CREASE


def test_flush_goal_has_one_plane_above_and_one_in_front() -> None:
    model, scene = build(flush.Flush(), target=PlanarPose(0.02, 0.01, 0.3))
    plate = body_poses(model)[flush.TARGET]
    in_plate = inverse(plate) @ scene.goal
    half = np.array(flush.HALF_BOX)
    low, high = transform(in_plate, np.array([-half, half]))
    assert high[2] == pytest.approx(flush.HALF_PLATE[2])  # the upper faces
    assert low[1] == pytest.approx(-flush.HALF_PLATE[1])  # the front faces
    assert low[0] == pytest.approx(flush.HALF_PLATE[0] + flush.GAP)  # beside the plate
    np.testing.assert_allclose(in_plate[:3, :3], np.eye(3), atol=1e-9)
    # The plane of the plate's face passes far above the box at its start, so that what is level is not flush.
    assert plate[2, 2] == pytest.approx(np.cos(flush.TILT_RAD))
    top = transform(inverse(plate) @ scene.start, np.array([[0.0, 0.0, half[2]]]))
    assert flush.HALF_PLATE[2] - top[0, 2] > 0.05
    # The lowest edge of the stand is on the table.
    stand = body_poses(model)["stand"]
    assert transform(stand, np.array([[-flush.HALF_STAND[0], 0.0, -2 * flush.HALF_STAND[2]]]))[0, 2] == pytest.approx(0)


def test_ring_goal_has_the_base_of_the_cup_in_the_ring() -> None:
    model, scene = build(ring.Ring(), target=PlanarPose(0.02, 0.01, 0.3))
    in_mat = inverse(body_poses(model)[ring.TARGET]) @ scene.goal
    np.testing.assert_allclose(in_mat[:3, 3], [0, 0, 2 * ring.HALF_THICKNESS], atol=1e-9)
    np.testing.assert_allclose(in_mat[:3, 2], [0, 0, 1], atol=1e-9)
    assert 0 < ring.RING_INNER - ring.RADIUS < 0.001
    assert ring.RING_OUTER - ring.RING_INNER > 0.006  # the other edge of the ring is no place for the base
    np.testing.assert_array_equal(scene.free_axis, [0, 0, 1])
    # The ring is where it says: dark at its middle radius, blank inside, on the texture of the mat.
    size = ring.PIXELS
    texture = next(
        model.tex_data[adr : adr + 3 * size * size].reshape(size, size, 3).astype(float).mean(axis=2)
        for adr, width in zip(model.tex_adr, model.tex_width, strict=True)
        if width == size
    )
    at = [texture[size // 2, round(size / 2 * (1 + r / ring.HALF_MAT))] for r in (0.02, 0.036, 0.037, 0.044, 0.045)]
    assert min(at[0], at[1], at[4]) > max(at[2], at[3]) + 40
