"""Recordings: the truth agrees with the pixels, the task is done, a seed makes it repeatable.

What a scenario has to make difficult is measured here from the ground truth alone.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from geoskill.geometry.camera import back_project, project
from geoskill.geometry.poses import inverse, rotation_vector, transform
from geoskill.simulation.conditions import Conditions
from geoskill.simulation.ground_truth import FrameGroundTruth
from geoskill.simulation.recording import Cloth, Recording, pack
from geoskill.simulation.roles import SceneRole
from geoskill.simulation.scene import HEIGHT, WIDTH, RecordingSettings, record
from geoskill.simulation.tasks import folding, insertion, screw, sorting
from geoskill.simulation.tasks.task import Task

Recorded = Callable[..., Recording]

TASKS = ["sorting", "insertion", "folding", "screw"]
RIGID = [name for name in TASKS if name != "folding"]
MILLIMETRE = 0.001
# Points of bodies that the camera sees on the first frame: in the middle of an upper face whose height is known. The
# prints are plates of 0.4 mm to either side of the face.
KNOWN = {
    "sorting": [("tile", (-0.03, -0.03, 0.002)), ("box", (0.0, -0.02, sorting.HALF_BOX[2] + 0.0004))],
    "insertion": [
        ("holder", (-0.037, -0.03, insertion.TOP + 0.0004)),
        ("block", (0.0, -0.05, insertion.HALF_BLOCK[2] + 0.0004)),
    ],
    "screw": [
        ("plate", (0.0, 0.0, 2 * screw.HALF_PLATE[2] + 0.0004)),
        ("screwdriver", (0.0, -0.0045, 0.06)),
    ],
}


def pose_of(recording: Recording, body: str, frame: int) -> np.ndarray:
    return np.asarray(recording.poses[frame, recording.bodies.index(body)])


def world_points(recording: Recording, frame: int, mask: np.ndarray) -> np.ndarray:
    """Where the pixels of a mask are in the world, by the depth."""
    rows, columns = np.nonzero(mask)
    depth = recording.depth_m(frame)[rows, columns].astype(np.float64)
    return back_project(recording.view(frame), np.column_stack([columns, rows]).astype(np.float64), depth)


def cloth_of(recording: Recording) -> Cloth:
    assert recording.cloth is not None
    return recording.cloth


def shown_pixels(recording: Recording, frame: int, role: SceneRole, every: int = 5) -> int:
    """How many pixels of a coarse grid show something of a role."""
    rows, columns = np.mgrid[:HEIGHT:every, :WIDTH:every].reshape(2, -1)
    numbers = recording.body_ids(frame)[rows, columns]
    bodies = [part.body for part in recording.roles if part.role is role]
    own = np.isin(numbers, [recording.bodies.index(body) for body in bodies])
    if recording.cloth is not None and recording.cloth.name in bodies:  # a part of it
        own = numbers == -1
    found = FrameGroundTruth(recording, frame).surface(np.column_stack([columns, rows])[own])
    return sum(point is not None and point.role is role for point in found)


@pytest.mark.parametrize("task", TASKS)
def test_size_bodies_and_roles(recorded: Recorded, task: str) -> None:
    recording = recorded(task, "demonstration")
    assert 4 <= len(recording) <= 5  # every 32nd frame of 80 to 110, and the last
    assert len(recording.shown) == len(recording.depths) == len(recording.poses) == len(recording.camera)
    assert recording.picture(0).shape == (HEIGHT, WIDTH, 3)
    assert recording.body_ids(0).shape == recording.depth_m(0).shape == (HEIGHT, WIDTH)
    assert {part.role for part in recording.roles} == set(SceneRole)
    assert all(part.body in recording.bodies for part in recording.roles)
    # All three are well seen at the start.
    assert all(shown_pixels(recording, 0, role) > 50 for role in SceneRole)


@pytest.mark.parametrize("task", RIGID)
def test_known_points_are_found_where_they_are_projected(recorded: Recorded, task: str) -> None:
    recording = recorded(task, "demonstration")
    for body, place in KNOWN[task]:
        there = transform(pose_of(recording, body, 0), np.array([place]))
        pixels, depth = project(recording.view(0), there)
        column, row = np.round(pixels[0]).astype(int)
        assert recording.bodies[recording.body_ids(0)[row, column]] == body
        assert recording.depth_m(0)[row, column] == pytest.approx(depth[0], abs=2 * MILLIMETRE)
        (point,) = FrameGroundTruth(recording, 0).surface(np.array([[column, row]]))
        assert point is not None
        # Half a pixel is about half a millimeter wide, and on the slant a little more.
        np.testing.assert_allclose(point.place, place, atol=2 * MILLIMETRE)


def test_the_table_is_a_plane_for_a_camera_that_moves(recorded: Recorded) -> None:
    recording = recorded("sorting", "move_camera", actor="robot", move_camera=True)
    table = recording.bodies.index("table")
    for frame in range(len(recording)):
        mask = recording.body_ids(frame) == table
        assert mask.sum() > 0.3 * mask.size
        heights = world_points(recording, frame, mask)[:, 2]
        # A pixel at the edge of a thing can have the depth of the one and the number of the other.
        assert np.mean(np.abs(heights) < 2 * MILLIMETRE) > 0.99


def test_the_boxs_faces_are_where_its_pose_says_on_all_frames(recorded: Recorded) -> None:
    recording = recorded("sorting", "demonstration")
    for frame in range(len(recording)):
        mask = recording.body_ids(frame) == recording.bodies.index("box")
        places = transform(inverse(pose_of(recording, "box", frame)), world_points(recording, frame, mask))
        apart = np.abs(places) - sorting.HALF_BOX
        # Inside the box within the thickness of a print, and on one of its faces.
        assert np.quantile(apart.max(axis=1), 0.99) < 2 * MILLIMETRE
        assert np.quantile(apart.max(axis=1), 0.01) > -2 * MILLIMETRE


def test_the_vertices_of_the_cloth_are_seen_where_they_are(recorded: Recorded) -> None:
    recording = recorded("folding", "demonstration")
    cloth = cloth_of(recording)
    assert cloth.vertices.shape == (len(recording), *cloth.rest.shape)
    # Flat at first, but for what is held: the target's part, without the vertices on the cloth's edge.
    mark = (cloth.rest[:, 0] > folding.MARK[0]) & (cloth.rest[:, 0] < folding.MARK[1])
    mark &= np.abs(cloth.rest[:, 1]) < 0.99 * folding.HALF[1]
    pixels, depth = project(recording.view(0), cloth.vertices[0][mark])
    columns, rows = np.round(pixels).astype(int).T
    assert np.all(recording.body_ids(0)[rows, columns] == -1)
    np.testing.assert_allclose(recording.depth_m(0)[rows, columns], depth, atol=2 * MILLIMETRE)
    found = FrameGroundTruth(recording, 0).surface(np.column_stack([columns, rows]))
    for point, place in zip(found, cloth.rest[mark], strict=True):
        assert point is not None
        np.testing.assert_allclose(point.place, place, atol=2 * MILLIMETRE)


@pytest.mark.parametrize("actor", ["human", pytest.param("robot", marks=pytest.mark.slow)])
@pytest.mark.parametrize("task", RIGID)
def test_the_object_comes_from_elsewhere_and_reaches_the_goal(recorded: Recorded, task: str, actor: str) -> None:
    take = "demonstration" if actor == "human" else "robot"
    recording = recorded(task, episode_rng, actor=actor)
    object_name, target = (
        next(part.body for part in recording.roles if part.role is role)
        for role in (SceneRole.OBJECT, SceneRole.TARGET)
    )
    first, last = (inverse(pose_of(recording, target, k)) @ pose_of(recording, object_name, k) for k in (0, -1))
    assert np.linalg.norm(first[:2, 3]) > 0.1
    if task == "sorting":
        expected = (0.0, 0.0, 0.002 + sorting.HALF_BOX[2])
    elif task == "insertion":
        slot_y = -insertion.HALF_HOLDER[1] + insertion.STOP + insertion.GAP + insertion.HALF_BLOCK[1]
        expected = (0.0, slot_y, insertion.FLOOR + insertion.HALF_BLOCK[2])
    else:
        column, row = last[0, 3] / screw.PITCH, last[1, 3] / screw.PITCH
        expected = (round(column) * screw.PITCH, np.sign(row) * screw.PITCH / 2, 0.003)
    np.testing.assert_allclose(last[:3, 3], expected, atol=1e-6)
    np.testing.assert_allclose(last[:3, :3], np.eye(3), atol=1e-6)


@pytest.mark.parametrize("actor", ["human", pytest.param("robot", marks=pytest.mark.slow)])
def test_the_end_of_the_cloth_comes_to_lie_on_the_mark(recorded: Recorded, actor: str) -> None:
    recording = recorded("folding", "demonstration" if actor == "human" else "robot", actor=actor)
    cloth = cloth_of(recording)
    placed = pose_of(recording, folding.NAME, 0)
    flat, folded = (transform(inverse(placed), cloth.vertices[frame]) for frame in (0, -1))
    end = cloth.rest[:, 0] > 2 * folding.CREASE - folding.MARK[1]
    rest = cloth.rest
    np.testing.assert_allclose(
        flat[~end & (rest[:, 0] < folding.CREASE)], rest[~end & (rest[:, 0] < folding.CREASE)], atol=0.01
    )
    mirrored = rest[end] * [-1, 1, 0] + [2 * folding.CREASE, 0, 0]
    apart = np.linalg.norm((folded[end] - mirrored)[:, :2], axis=1)
    assert np.median(apart) < 5 * MILLIMETRE
    assert apart.max() < 15 * MILLIMETRE
    assert np.all(folded[end][:, 2] > 0)
    assert folded[:, 2].max() < 0.04


@pytest.mark.parametrize("task", ["sorting", "folding"])
def test_a_seed_makes_a_recording_repeatable(recorded: Recorded, task_called: Callable[[str], Task], task: str) -> None:
    first = pack(recorded(task, "demonstration"))
    again = pack(record(RecordingSettings(task_called(task), Conditions("human"), 0, "demonstration", 32)))
    assert first.keys() == again.keys()
    for name, array in first.items():
        assert array.tobytes() == again[name].tobytes(), name


@pytest.mark.slow
def test_another_take_shows_the_same_things_elsewhere(recorded: Recorded) -> None:
    first, other, looks = (recorded("sorting", *which) for which in (("demonstration",), ("human",), ("human", 1)))
    for body in ("tile", "box"):
        assert np.abs(pose_of(first, body, 0) - pose_of(other, body, 0)).max() > 0.001

    def tiles(recording: Recording) -> np.ndarray:
        """The mean color of each tile, from the back left one on, which light and view change but little."""
        names = [name for name in recording.bodies if name == "tile" or name.startswith("distractor")]
        masks = [recording.body_ids(0) == recording.bodies.index(name) for name in names]
        return np.array([recording.picture(0)[mask].mean(axis=0) for mask in masks])

    assert np.abs(tiles(first) - tiles(other)).max() < 15
    assert np.abs(tiles(first) - tiles(appearance_rng)).max() > 30


def test_frames_left_out_move_things_all_the_same(
    recorded: Recorded, task_called: Callable[[str], Task], opengl: None
) -> None:
    coarse = recorded("sorting", "demonstration")
    fine = record(RecordingSettings(task_called("sorting"), Conditions("human"), 0, "demonstration", 16))
    np.testing.assert_array_equal(fine.poses[: 2 * len(coarse) - 2 : 2], coarse.poses[:-1])
    np.testing.assert_array_equal(fine.poses[-1], coarse.poses[-1])
    with pytest.raises(ValueError, match="stride=0: expected at least 1"):
        RecordingSettings(task_called("sorting"), Conditions("human"), 0, "demonstration", 0)


# From here on: what the scenarios promise. Every 6th frame shows it.
SEEDS = [0, 1, 2]
Hard = dict[str, Any]


def usual_and_hard(recorded: Recorded, task: str, scenario: str, seed: int) -> tuple[Recording, Recording]:
    """A robot's take without and with what the scenario makes difficult."""
    settings: Hard = {"actor": "robot", "stride": 6, scenario: True}
    return recorded(task, scenario, seed, severity=0.0, **settings), recorded(task, scenario, seed, **settings)


@pytest.mark.slow
@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("task", TASKS)
def test_illumination_takes_most_of_the_light(recorded: Recorded, task: str, seed: int) -> None:
    usual, dark = usual_and_hard(recorded, task, "illumination", seed)
    lit, unlit = (np.array([rec.picture(k).mean() for k in range(len(rec))]) for rec in (usual, dark))
    assert unlit.mean() <= 0.3 * lit.mean()
    assert np.ptp(unlit) > 0.5  # the lamp moves
    np.testing.assert_array_equal(
        usual.poses[:, usual.bodies.index("table")], dark.poses[:, dark.bodies.index("table")]
    )


@pytest.mark.slow
@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("task", TASKS)
def test_the_camera_turns(recorded: Recorded, task: str, seed: int) -> None:
    recording = recorded(task, "move_camera", seed, actor="robot", move_camera=True)
    turn = recording.camera[0, :3, :3].T @ recording.camera[-1, :3, :3]
    assert 20 <= np.degrees(np.linalg.norm(rotation_vector(turn))) <= 40
    assert np.linalg.norm(recording.camera[0, :3, 3] - recording.camera[-1, :3, 3]) > 0.1
    # What is to be seen stays in the picture.
    assert all(
        shown_pixels(recording, k, role) > 10
        for k in range(len(recording))
        for role in (SceneRole.OBJECT, SceneRole.TARGET)
    )


@pytest.mark.slow
@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("task", TASKS)
def test_occlusion_hides_half_of_object_or_target_for_a_third_of_the_time(
    recorded: Recorded, task: str, seed: int
) -> None:
    usual, hidden = usual_and_hard(recorded, task, "occlusion", seed)
    half_hidden = np.zeros(len(usual), bool)
    for role in (SceneRole.OBJECT, SceneRole.TARGET):
        before, after = (np.array([shown_pixels(rec, k, role) for k in range(len(rec))]) for rec in (usual, hidden))
        assert np.all(after <= before * 1.05 + 3)  # nothing comes to light
        half_hidden |= (after <= before / 2) & (before > 0)
    assert half_hidden.mean() >= 1 / 3
    assert not half_hidden[0]
    assert not half_hidden[-1]


@pytest.mark.slow
@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("task", TASKS)
def test_the_object_is_out_of_the_picture_for_a_quarter_of_the_time(recorded: Recorded, task: str, seed: int) -> None:
    recording = recorded(task, "outside_fov", seed, stride=6, actor="robot", outside_fov=True)
    shown = np.array([shown_pixels(recording, k, SceneRole.OBJECT, every=2) for k in range(len(recording))])
    assert np.mean(shown == 0) >= 0.25
    assert shown[0] > 0
    assert shown[-1] > 0
    gone = np.flatnonzero(shown == 0)
    assert np.all(np.diff(gone) == 1)  # it leaves once


@pytest.mark.slow
def test_random_targets_lie_farther_apart_on_other_tables(recorded: Recorded) -> None:
    usual, random = (
        [recorded("sorting", "random_target", seed, actor="robot", random_target=hard) for seed in SEEDS]
        for hard in (False, True)
    )
    spreads = [
        np.ptp([pose_of(recording, "tray", 0)[:2, 3] for recording in recordings], axis=0).max()
        for recordings in (usual, rng)
    ]
    assert spreads[1] > 2 * spreads[0]
    for ordinary, elsewhere in zip(usual, rng, strict=True):
        tables = [rec.picture(0)[rec.body_ids(0) == rec.bodies.index("table")] for rec in (ordinary, elsewhere)]
        assert abs(tables[0].mean() - tables[1].mean()) + abs(tables[0].std() - tables[1].std()) > 2
