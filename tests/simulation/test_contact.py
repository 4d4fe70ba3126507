"""Contact and gravity: what is let go over its place rests there, what is let go beside it does not."""

from collections.abc import Callable

import numpy as np
import pytest

from geoskill.config import ScenarioConfig
from geoskill.errors import InputError
from geoskill.geometry.poses import pose, rotation_about
from geoskill.simulation.stage import Stage
from geoskill.simulation.tasks.task import Task

TaskNamed = Callable[[str], Task]
SUPPORTS = {"sorting": "tile", "insertion": "holder", "flush": "stand", "ring": "mat"}
ROBOT = ScenarioConfig("robot", random_target=True)


def above(stage: Stage, up: float, x: float = 0.0, y: float = 0.0, yaw: float = 0.0) -> np.ndarray:
    """Return the goal, displaced in the world and turned about the object's vertical."""
    return pose((x, y, up)) @ stage.scene.goal @ pose((0, 0, 0), rotation_about(np.array([0.0, 0.0, yaw])))


def let_go(stage: Stage, where: np.ndarray) -> None:
    stage.put(where)
    stage.lead(where, held=False, opening=1.0, seconds=1.5)


@pytest.mark.parametrize("task", SUPPORTS)
def test_descent_stops_at_the_support_and_what_is_let_go_there_stays(task_named: TaskNamed, task: str) -> None:
    with Stage(task_named(task), ROBOT, 0, "robot 1", contact=True) as stage:
        stage.put(above(stage, 0.02))
        heights = []
        for step in range(5):
            stage.lead(above(stage, 0.012 - 0.008 * step), seconds=0.1)
            heights.append(stage.distance_to_goal().mm)
        # Led to 12, 4, -4, -12 and -20 mm above the goal.
        assert heights[:2] == pytest.approx([12, 4], abs=0.3)
        # The actor gives way along the force alone, which on the slope of flush is not upward.
        assert max(heights[2:]) < (1.5 if task == "flush" else 0.4)
        assert SUPPORTS[task] in stage.touched()
        assert sum(stage.touched().values()) < 8  # newtons: it does not press on
        stage.lead(stage.scene.goal, held=False, opening=1.0, seconds=0.3)
        left = stage.distance_to_goal()
        assert left.mm < (1.5 if task == "flush" else 0.1)
        assert left.deg == pytest.approx(0, abs=0.1)
        # And up again, by the same actor.
        stage.lead(above(stage, 0.03), seconds=0.3)
        assert stage.distance_to_goal().mm == pytest.approx(30, abs=0.3)
        assert not stage.touched()


@pytest.mark.slow
@pytest.mark.parametrize("task", SUPPORTS)
def test_object_that_is_let_go_above_its_place_rests_there(task_named: TaskNamed, task: str) -> None:
    with Stage(task_named(task), ROBOT, 0, "robot 1", contact=True) as stage:
        # In the slot there is a millimeter to either side.
        for x, y, yaw in ((0.0, 0.0, 0.0), (0.0005, -0.0003, 0.008)):
            let_go(stage, above(stage, 0.02, x, y, yaw))
            left = stage.distance_to_goal()
            assert left.mm < 1.0
            assert left.deg < 0.6
            assert sum(stage.touched().values()) == pytest.approx(
                9.81 * stage._model.body(stage.scene.dynamics.body).mass[0],  # type: ignore[attr-defined]
                rel=0.1,  # the stand of flush is a slope of 20 degrees
            )
        let_go(stage, above(stage, 0.02, x=0.06))
        assert stage.distance_to_goal().mm > 20


@pytest.mark.slow
def test_distance_to_goal_along_and_across_the_line_of_sight(task_named: TaskNamed) -> None:
    with Stage(task_named("sorting"), ROBOT, 0, "robot 1") as stage:
        sight = stage.scene.goal[:3, 3] - stage.camera.pose[:3, 3]
        sight /= np.linalg.norm(sight)
        aside = np.cross(sight, [0.0, 0.0, 1.0])
        aside /= np.linalg.norm(aside)
        where = above(stage, 0.0, yaw=0.2)
        where[:3, 3] += -0.004 * sight + 0.003 * aside
        stage.lead(where)
        left = stage.distance_to_goal()
        assert (left.mm, left.along_mm, left.across_mm) == pytest.approx((5, 4, 3), abs=1e-6)
        assert left.deg == pytest.approx(np.degrees(0.2))
        assert stage.touched() == {}


@pytest.mark.parametrize("task", ["folding", "screw"])
def test_contact_is_refused_where_nothing_stops_the_object(task_named: TaskNamed, task: str) -> None:
    with pytest.raises(InputError, match=rf"^contact of the task {task}: its object is flexible, or ends inside of"):
        Stage(task_named(task), ROBOT, 0, "robot 1", contact=True)
