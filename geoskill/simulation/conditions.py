"""Under which conditions a task is recorded: who does it, and what is made difficult."""

import math
from dataclasses import dataclass
from typing import final

import numpy as np
from jaxtyping import Float64

from geoskill.errors import InputError
from geoskill.geometry.camera import looking_at
from geoskill.geometry.poses import Pose, rotation_about
from geoskill.simulation.motion import minimum_jerk
from geoskill.simulation.tasks.task import Spread

ACTORS = ("human", "robot")
# Of every recording: nobody puts things twice in the same place.
USUAL_SPREAD = Spread(0.012, 0.012, math.radians(8))
RANDOM_TARGET_SPREAD = Spread(0.045, 0.035, math.radians(35))
START_SPREAD = Spread(0.02, 0.02, math.radians(30))

CAMERA_POSITION = np.array([0.0, -0.46, 0.56])
CAMERA_TARGET = np.array([0.02, 0.02, 0.02])

# When the camera looks aside and is back, in shares of the recording, how long it turns, and how far.
ASIDE_BEGIN, ASIDE_END, ASIDE_TURN, ASIDE_RAD = 0.06, 0.62, 0.12, math.radians(52)


@final
@dataclass(frozen=True)
class Conditions:
    """The conditions of a recording (Fig. 8 of the paper).

    Attributes:
        actor: ``human`` or ``robot``.
        confidence: of a human demonstrator, in (0, 1]; the less, the larger detours, hesitations and jitter.
        random_target: another table, and the target anywhere on it.
        move_camera: the camera turns about the scene and is displaced while it records.
        occlusion: something passes before the target.
        outside_fov: the object leaves the picture and comes back: it is carried out, or the camera looks aside.
        illumination: the room is dark, and a lamp is moved about in it.
        severity: of whatever is made difficult: 1 as described, 0 not at all.

    Raises:
        InputError: when the actor is unknown, or the confidence or the severity out of range.
    """

    actor: str
    confidence: float = 0.93
    random_target: bool = False
    move_camera: bool = False
    occlusion: bool = False
    outside_fov: bool = False
    illumination: bool = False
    severity: float = 1.0

    def __post_init__(self) -> None:
        if self.actor not in ACTORS:
            raise InputError(f"scenario.actor={self.actor}: expected {' or '.join(ACTORS)}")
        if not 0 < self.confidence <= 1:
            raise InputError(f"scenario.confidence={self.confidence}: expected more than 0 and at most 1")
        if not 0 <= self.severity <= 1.5:
            raise InputError(f"scenario.severity={self.severity}: expected 0 to 1.5")

    def target_spread(self) -> Spread:
        """How far the target may lie from its usual place."""
        return scaled(RANDOM_TARGET_SPREAD, self.severity) if self.random_target else USUAL_SPREAD


def scaled(spread: Spread, factor: float) -> Spread:
    """A spread made wider or narrower."""
    return Spread(spread.x * factor, spread.y * factor, spread.yaw_rad * factor)


def camera_course(
    conditions: Conditions, frames: int, random: np.random.Generator
) -> Float64[np.ndarray, "frames 4 4"]:
    """Poses of the camera: at rest near its usual place, or turning by 25 to 35 degrees in all about the scene.

    It goes round the scene's vertical and rolls about its own axis, which together make the turn, while it is displaced
    by some centimeters.
    """
    position = CAMERA_POSITION + random.uniform(-0.015, 0.015, 3)
    target = CAMERA_TARGET + random.uniform(-0.01, 0.01, 3)
    if not conditions.move_camera:
        return np.repeat(looking_at(position, target)[None], frames, axis=0)
    side = random.choice([-1.0, 1.0])
    azimuth = side * conditions.severity * math.radians(random.uniform(18, 24))
    # Seen from behind, the camera looks down: the other way about its axis adds to the turn about the vertical.
    roll = -side * conditions.severity * math.radians(random.uniform(8, 14))
    shift = conditions.severity * random.uniform(-0.03, 0.03, 3)
    course: list[Pose] = []
    for share in minimum_jerk(np.linspace(0, 1, frames)):
        cosine, sine = math.cos(share * azimuth), math.sin(share * azimuth)
        about = np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]])
        course.append(looking_at(target + about @ (position - target) + share * shift, target, share * roll))
    return np.stack(course)


def looking_aside(camera: Float64[np.ndarray, "frames 4 4"], severity: float) -> Float64[np.ndarray, "frames 4 4"]:
    """The same course, but that the camera is panned to its left for a while: what it sees leaves to the right."""
    share = np.linspace(0, 1, len(camera))
    panned = minimum_jerk(np.clip(np.minimum(share - ASIDE_BEGIN, ASIDE_END - share) / ASIDE_TURN, 0, 1))
    course = camera.copy()
    for matrix, part in zip(course, panned, strict=True):
        # About the vertical, as on a tripod: the horizon stays level, and the table fills the picture.
        matrix[:3, :3] = rotation_about(np.array([0.0, 0.0, part * severity * ASIDE_RAD])) @ matrix[:3, :3]
    return course
