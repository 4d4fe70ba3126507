"""Distance of an object from where it belongs."""

from dataclasses import dataclass
from typing import final

import numpy as np

from geoskill.geometry.camera import PinholeCamera
from geoskill.geometry.poses import Pose, rotation_vector
from geoskill.simulation.tasks.task import TaskScene


@final
@dataclass(frozen=True)
class GoalDistance:
    """How far an object is from its goal.

    Attributes:
        mm: distance of the origins of both frames, millimeters.
        along_mm: the part of it along the line of sight to the goal.
        across_mm: the part across that line, which a picture shows.
        deg: angle of the turn between both, degrees; where the goal leaves the object free to turn about an axis, the
            angle between that axis and where it belongs.
    """

    mm: float
    along_mm: float
    across_mm: float
    deg: float


def distance_to_goal(object_pose: Pose, scene: TaskScene, view: PinholeCamera) -> GoalDistance:
    """Return how far an object at a pose in the world is from the goal of a scene, seen by a camera."""
    missing = 1000 * (object_pose[:3, 3] - scene.goal[:3, 3])
    sight = scene.goal[:3, 3] - view.pose[:3, 3]
    along = float(missing @ sight / np.linalg.norm(sight))
    total = float(np.linalg.norm(missing))
    if scene.free_axis is None:
        angle = float(np.linalg.norm(rotation_vector(object_pose[:3, :3] @ scene.goal[:3, :3].T)))
    else:
        axes = (own[:3, :3] @ scene.free_axis for own in (object_pose, scene.goal))
        first, second = (axis / np.linalg.norm(axis) for axis in axes)
        angle = float(np.arctan2(np.linalg.norm(np.cross(first, second)), first @ second))
    return GoalDistance(total, abs(along), float(np.sqrt(max(0.0, total**2 - along**2))), float(np.degrees(angle)))
