"""What a scenario makes of a recording: where the target may lie, and how the camera moves."""

import math

import numpy as np
from jaxtyping import Float64

from geoskill.config import ScenarioConfig
from geoskill.geometry.camera import look_at
from geoskill.geometry.poses import Pose, rotation_about
from geoskill.simulation.motion import minimum_jerk
from geoskill.simulation.tasks.task import PlacementRange

# Applies to every recording, since nobody puts things twice in the same place.
USUAL_TARGET_RANGE = PlacementRange(0.012, 0.012, math.radians(8))
RANDOM_TARGET_RANGE = PlacementRange(0.045, 0.035, math.radians(35))
START_RANGE = PlacementRange(0.02, 0.02, math.radians(30))

CAMERA_POSITION = np.array([0.0, -0.46, 0.56])
# From the right, so that the lines of sight of both cameras cross at about 70 degrees.
SECOND_CAMERA_POSITION = np.array([0.56, -0.20, 0.50])
CAMERA_TARGET = np.array([0.02, 0.02, 0.02])

# A camera that pans aside leaves the scene at ASIDE_BEGIN and is back at ASIDE_END; turning takes ASIDE_TURN each way.
# All are shares of the recording.
ASIDE_BEGIN, ASIDE_END, ASIDE_TURN, ASIDE_RAD = 0.06, 0.62, 0.12, math.radians(52)


def target_range(scenario: ScenarioConfig) -> PlacementRange:
    """Return the range of the target's placement about its usual one."""
    return RANDOM_TARGET_RANGE.scaled(scenario.severity) if scenario.random_target else USUAL_TARGET_RANGE


def camera_trajectory(
    scenario: ScenarioConfig,
    frames: int,
    rng: np.random.Generator,
    usual: Float64[np.ndarray, "3"] = CAMERA_POSITION,
) -> Float64[np.ndarray, "frames 4 4"]:
    """Return a camera's pose on every frame: at rest near its usual place, or turning about the scene.

    A moving camera goes around the scene's vertical and rolls about its own axis, by 25 to 35 degrees together at
    severity 1, and shifts by some centimeters.
    """
    position = usual + rng.uniform(-0.015, 0.015, 3)
    target = CAMERA_TARGET + rng.uniform(-0.01, 0.01, 3)
    if not scenario.move_camera:
        return np.repeat(look_at(position, target)[None], frames, axis=0)
    side = rng.choice([-1.0, 1.0])
    azimuth = side * scenario.severity * math.radians(rng.uniform(18, 24))
    # The camera looks down: seen from behind, the opposite roll adds to the turn about the vertical.
    roll = -side * scenario.severity * math.radians(rng.uniform(8, 14))
    shift = scenario.severity * rng.uniform(-0.03, 0.03, 3)
    trajectory: list[Pose] = []
    for progress in minimum_jerk(np.linspace(0, 1, frames)):
        cosine, sine = math.cos(progress * azimuth), math.sin(progress * azimuth)
        turn = np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]])
        camera_position = target + turn @ (position - target) + progress * shift
        trajectory.append(look_at(camera_position, target, progress * roll))
    return np.stack(trajectory)


def pan_aside(camera_poses: Float64[np.ndarray, "frames 4 4"], severity: float) -> Float64[np.ndarray, "frames 4 4"]:
    """Return a copy of a camera trajectory that pans to the left for a while, so that the scene leaves to the right."""
    time = np.linspace(0, 1, len(camera_poses))
    panned = minimum_jerk(np.clip(np.minimum(time - ASIDE_BEGIN, ASIDE_END - time) / ASIDE_TURN, 0, 1))
    trajectory = camera_poses.copy()
    for camera_pose, fraction in zip(trajectory, panned, strict=True):
        # About the vertical, as on a tripod: the horizon stays level, and the table fills the image.
        turn = rotation_about(np.array([0.0, 0.0, fraction * severity * ASIDE_RAD]))
        camera_pose[:3, :3] = turn @ camera_pose[:3, :3]
    return trajectory
