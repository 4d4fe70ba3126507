"""The stage: recordings as they were before there was one, and scenes that are led anywhere."""

from collections.abc import Callable, Iterator

import numpy as np
import pytest

from geoskill.config import ScenarioConfig
from geoskill.errors import InputError
from geoskill.geometry.camera import project
from geoskill.geometry.poses import pose, rotation_about
from geoskill.simulation.ground_truth import FrameGroundTruth, goal_pixels
from geoskill.simulation.recording import Recording
from geoskill.simulation.roles import SceneRole
from geoskill.simulation.stage import Stage
from geoskill.simulation.tasks.task import Task

Recorded = Callable[..., Recording]
TaskNamed = Callable[[str], Task]

# Measured at commit 99ed465, before the stage was taken out of the recordings: frames; weighted sums of all bodies'
# poses, of the camera's and of the cloth's vertices; mean intensities; pixels of the target, or of the cloth.
BEFORE = {
    "sorting": (5, 1.379345914, 0.780383437, None, [125.8, 114.0, 114.3, 118.4, 120.6], [5445, 5497, 1016, 1487, 2304]),
    "insertion": (
        *(5, -6.015270125, 0.757586316, None),
        *([116.4, 108.0, 116.2, 116.7, 118.0], [12066, 12075, 1920, 10003, 10007]),
    ),
    "folding": (4, 4.543858584, 0.595323478, 0.10909, [128.3, 122.7, 123.1, 123.9], [43818, 12293, 20382, 28566]),
    "screw": (5, -0.144260280, 0.831753532, None, [122.4, 110.1, 118.2, 119.4, 118.2], [10964, 2061, 2352, 9533, 9539]),
}


def weighted_sum(array: np.ndarray) -> float:
    """Return a number that changes with any element and any change of their order."""
    return float(array.ravel() @ np.cos(np.arange(array.size)))


@pytest.mark.slow
@pytest.mark.parametrize("task", BEFORE)
def test_recordings_are_those_of_before_the_stage(recorded: Recorded, task: str) -> None:
    recording = recorded(
        task, "before the stage", 1, actor="robot", random_target=True, move_camera=True, occlusion=True
    )
    frames, body_poses, camera_poses, vertices, means, pixels = BEFORE[task]
    assert len(recording) == frames
    assert weighted_sum(recording.poses) == pytest.approx(body_poses, abs=1e-6)
    assert weighted_sum(recording.camera_poses) == pytest.approx(camera_poses, abs=1e-6)
    if recording.cloth is not None:
        assert weighted_sum(recording.cloth.vertices) == pytest.approx(vertices, abs=1e-4)
    # Builds of Mesa differ at edges and in the last bit of a color.
    assert [recording.picture(k).mean() for k in range(frames)] == pytest.approx(means, abs=0.5)
    target = -1 if recording.cloth is not None else recording.bodies.index(recording.roles[1].body)
    shown = [int((recording.body_ids(k) == target).sum()) for k in range(frames)]
    assert shown == pytest.approx(pixels, rel=0.01)


@pytest.fixture(scope="module")
def stage(opengl: None, task_named: TaskNamed) -> Iterator[Stage]:
    with Stage(task_named("sorting"), ScenarioConfig("robot"), 0, "robot") as stage:
        yield stage


def object_pose(stage: Stage) -> np.ndarray:
    return np.asarray(stage.poses()[stage.bodies().index("box")])


def test_object_starts_at_its_start_and_goes_where_it_is_led(stage: Stage) -> None:
    np.testing.assert_allclose(stage.motion.object_poses[0], stage.scene.start)
    aside = stage.scene.goal @ pose((0.05, 0.0, 0.1), rotation_about(np.array([0.0, 0.0, 0.4])))
    for where in (stage.scene.start, aside):
        stage.lead(where)
        np.testing.assert_allclose(object_pose(stage), where, atol=1e-9)
        actor = stage.poses()[stage.bodies().index("actor")]
        np.testing.assert_allclose(actor, where @ stage.scene.grip.pose, atol=1e-9)
    # What is shown is what has been led: the point of the box's top that the camera sees there.
    (column, row), depth = (values[0] for values in project(stage.camera, (aside @ [0, -0.02, 0.0184, 1])[None, :3]))
    assert stage.bodies()[stage.body_ids()[round(row), round(column)]] == "box"
    assert stage.depth_m()[round(row), round(column)] == pytest.approx(depth, abs=0.002)


def test_picture_is_the_same_until_something_moves(stage: Stage) -> None:
    stage.lead(stage.scene.start)
    first = stage.picture()
    np.testing.assert_array_equal(first, stage.picture())
    stage.lead(stage.scene.start)
    noise = stage.picture().astype(float) - first
    assert 0.5 < noise.std() < 5


def test_shot_tells_the_ground_truth_of_the_present_and_of_the_goal(stage: Stage) -> None:
    stage.lead(stage.scene.start)
    shot = stage.shot()
    assert len(shot) == 1
    assert {part.role for part in shot.roles} == set(SceneRole)
    np.testing.assert_array_equal(shot.picture(0), stage.picture())
    top = np.array([0.0, -0.01, 0.0184, 1.0])
    pixel = np.round(project(stage.camera, (stage.scene.start @ top)[None, :3])[0]).astype(int)
    (point,) = FrameGroundTruth(shot, 0).at(pixel)
    assert point is not None
    assert (point.body, point.role) == ("box", SceneRole.OBJECT)
    np.testing.assert_allclose(point.position, top[:3], atol=0.002)
    stage.lead(stage.scene.goal)
    expected, _ = project(stage.camera, (stage.scene.goal @ top)[None, :3])
    np.testing.assert_allclose(goal_pixels(stage.shot(), [point]), expected, atol=2)


def test_stage_needs_no_opengl_until_something_is_rendered(
    task_named: TaskNamed, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: object) -> None:
        raise InputError("no OpenGL context for rendering")

    monkeypatch.setattr("geoskill.simulation.stage.Renderer", fail)
    with Stage(task_named("screw"), ScenarioConfig("robot"), 0, "robot") as stage:
        stage.lead(stage.scene.goal)
        assert len(stage.poses()) == len(stage.bodies())
        with pytest.raises(InputError, match="no OpenGL"):
            stage.picture()
    with pytest.raises(InputError, match="seed=-1: expected 0 or more"):
        Stage(task_named("screw"), ScenarioConfig("robot"), -1, "robot")


@pytest.mark.slow
def test_surroundings_move_on_their_own(opengl: None, task_named: TaskNamed) -> None:
    scenario = ScenarioConfig("robot", move_camera=True, illumination=True, occlusion=True)
    with Stage(task_named("sorting"), scenario, 0, "robot") as stage:
        at_first = {name: stage.poses()[stage.bodies().index(name)] for name in ("camera", "lamp", "passer_by", "box")}
        stage.surround(len(stage) // 2)
        then = {name: stage.poses()[stage.bodies().index(name)] for name in at_first}
        assert [bool(np.any(at_first[name] != then[name])) for name in at_first] == [True, True, True, False]
        np.testing.assert_allclose(stage.camera.pose[:3, 3], then["camera"][:3, 3], atol=1e-12)
        stage.surround(len(stage) + 10)  # stays at the last frame
        last = stage.camera.pose
        stage.surround(len(stage) - 1)
        np.testing.assert_array_equal(stage.camera.pose, last)


@pytest.mark.slow
def test_second_camera_sees_the_same_and_changes_nothing_for_the_first(opengl: None, task_named: TaskNamed) -> None:
    arguments = (task_named("sorting"), ScenarioConfig("robot"), 0, "robot")
    with Stage(*arguments) as stage:
        stage.lead(stage.scene.start)
        alone, bodies = stage.picture(), stage.bodies()
        assert stage.cameras == ("camera",)
    with Stage(*arguments, second_camera=True) as stage:
        stage.lead(stage.scene.start)
        assert stage.bodies() == [*bodies, "second_camera"]
        np.testing.assert_array_equal(stage.picture(), alone)
        assert stage.cameras == ("camera", "second_camera")
        top = (stage.scene.start @ [0.0, 0.0, 0.0184, 1.0])[None, :3]
        sights = []
        for name in stage.cameras:
            view = stage.view(name)
            (column, row), depth = (values[0] for values in project(view, top))
            assert stage.bodies()[stage.body_ids(name)[round(row), round(column)]] == "box"
            assert stage.depth_m(name)[round(row), round(column)] == pytest.approx(depth, abs=0.002)
            sights.append((top[0] - view.pose[:3, 3]) / np.linalg.norm(top[0] - view.pose[:3, 3]))
            assert len(FrameGroundTruth(stage.shot(name), 0).at(np.array([[round(column), round(row)]]))) == 1
        assert 50 < np.degrees(np.arccos(sights[0] @ sights[1])) < 90
        assert np.abs(stage.picture("second_camera").astype(float) - stage.picture()).mean() > 5
