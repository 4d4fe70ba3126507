"""Motion of the object from its start to its goal, as a person or as a robot carries it."""

import math
from dataclasses import dataclass
from typing import final

import numpy as np
from jaxtyping import Bool, Float64

from geoskill.geometry.poses import Pose, rotation_about, rotation_vector

PerFrame = Float64[np.ndarray, " frames"]

# Shares of the recording: held at the start, carried above the goal, lowered onto it, released.
# In the rest of it, the actor retreats.
HOLD, CARRY, LOWER, RELEASE = 0.05, 0.62, 0.18, 0.05


@final
@dataclass(frozen=True, eq=False)
class ScriptedMotion:
    """Motion of the object and the actor, one entry per frame.

    Attributes:
        object_poses: world poses of the object.
        held: whether the actor still holds the object.
        opening: of the fingers, from 0 to 1.
        retreat_m: distance by which the actor has retreated from the object.
    """

    object_poses: Float64[np.ndarray, "frames 4 4"]
    held: Bool[np.ndarray, " frames"]
    opening: PerFrame
    retreat_m: PerFrame


@final
@dataclass(frozen=True, eq=False)
class PathSpec:
    """Specification of the object's path.

    Attributes:
        start: first pose of the object in the world.
        goal: last pose of the object in the world.
        approach: from the goal to the beginning of the final straight segment, meters.
        height: rise of the path above the higher of its ends, meters.
        detour: a point through which the path passes halfway, if any; it then replaces ``height``.
    """

    start: Pose
    goal: Pose
    approach: Float64[np.ndarray, "3"]
    height: float
    detour: Float64[np.ndarray, "3"] | None = None


def human_motion(path: PathSpec, frames: int, confidence: float, rng: np.random.Generator) -> ScriptedMotion:
    """Return a motion along a curved path with a minimum-jerk speed profile and the tremor of a hand.

    Args:
        path: the path's start, goal and shape.
        frames: number of frames.
        confidence: of the person, in (0, 1]; low values cause large deviations, hesitations and tremor.
        rng: draws the path, the speed and the tremor.
    """
    doubt = 1.0 - confidence
    deviation = rng.normal(0, 1, 3) * np.array([1.0, 1.0, 0.5]) * (0.018 + 0.12 * doubt)
    progress = minimum_jerk(np.linspace(0, 1, max(2, round(CARRY * frames))) ** rng.uniform(0.8, 1.15))
    hesitation = np.sin(2 * math.pi * rng.integers(2, 4) * progress) * np.sin(math.pi * progress)
    progress = np.clip(progress + 0.35 * doubt * hesitation, 0, 1)
    object_poses = _object_poses(path, progress, frames, deviation)
    tremor = 0.0006 + 0.006 * doubt
    # A hand that rests on the table does not tremble.
    strength = np.sin(math.pi * np.clip(np.linspace(0, 1, frames) / (HOLD + CARRY + LOWER), 0, 1))[:, None]
    shifts = tremor * strength * _tremor(frames, 3, rng)
    turns = 6 * tremor / 0.1 * strength * _tremor(frames, 3, rng)
    for object_pose, shift, turn in zip(object_poses, shifts, turns, strict=True):
        object_pose[:3, 3] += shift * np.array([1.0, 1.0, 0.4])
        object_pose[:3, :3] = rotation_about(turn) @ object_pose[:3, :3]
    return _with_release(object_poses, frames)


def robot_motion(path: PathSpec, frames: int) -> ScriptedMotion:
    """Return a motion with a trapezoidal speed profile (ramp up, constant, ramp down), without tremor."""
    time = np.linspace(0, 1, max(2, round(CARRY * frames)))
    ramp = 0.25
    rising = np.minimum(time, ramp) ** 2 / (2 * ramp)
    level = np.clip(time - ramp, 0, 1 - 2 * ramp)
    falling = np.clip(time - (1 - ramp), 0, ramp)
    progress = (rising + level + falling - falling**2 / (2 * ramp)) / (1 - ramp)
    return _with_release(_object_poses(path, progress, frames, np.zeros(3)), frames)


def minimum_jerk(time: PerFrame) -> PerFrame:
    """Return the progress of a human reach from 0 to 1 at a time from 0 to 1 (Flash and Hogan, 1985).

    >>> minimum_jerk(np.array([0.0, 0.5, 1.0]))
    array([0. , 0.5, 1. ])
    """
    return np.asarray(10 * time**3 - 15 * time**4 + 6 * time**5)


def _object_poses(
    path: PathSpec, progress: Float64[np.ndarray, " carried"], frames: int, deviation: Float64[np.ndarray, "3"]
) -> Float64[np.ndarray, "frames 4 4"]:
    """Return a rest at the start, a cubic Bezier curve to above the goal, a straight segment onto it, and a rest."""
    first, last = path.start[:3, 3], path.goal[:3, 3]
    above = last + path.approach
    controls = _bezier_controls(path, first, above, deviation)
    if path.detour is not None:
        # Slow down where the object is farthest away.
        progress = progress + 0.85 * np.sin(2 * math.pi * progress) / (2 * math.pi)
    share = progress[:, None]
    curve = (
        (1 - share) ** 3 * controls[0]
        + 3 * (1 - share) ** 2 * share * controls[1]
        + 3 * (1 - share) * share**2 * controls[2]
        + share**3 * controls[3]
    )
    lowered = minimum_jerk(np.linspace(0, 1, max(2, round(LOWER * frames))))[:, None]
    held = np.repeat(first[None], round(HOLD * frames), axis=0)
    positions = np.concatenate([held, curve, above + lowered * (last - above)])[:frames]
    positions = np.concatenate([positions, np.repeat(last[None], frames - len(positions), axis=0)])
    turn = rotation_vector(path.goal[:3, :3] @ path.start[:3, :3].T)
    turned = np.concatenate([np.zeros(len(held)), progress])[:frames]
    turned = np.concatenate([turned, np.ones(frames - len(turned))])
    object_poses = np.repeat(np.eye(4)[None], frames, axis=0)
    object_poses[:, :3, 3] = positions
    for object_pose, fraction in zip(object_poses, turned, strict=True):
        object_pose[:3, :3] = rotation_about(fraction * turn) @ path.start[:3, :3]
    return object_poses


def _bezier_controls(
    path: PathSpec,
    first: Float64[np.ndarray, "3"],
    above: Float64[np.ndarray, "3"],
    deviation: Float64[np.ndarray, "3"],
) -> Float64[np.ndarray, "4 3"]:
    top = max(first[2], above[2]) + path.height
    over_start = np.array([*(0.75 * first[:2] + 0.25 * above[:2]), top])
    over_goal = np.array([*(0.25 * first[:2] + 0.75 * above[:2]), top])
    if path.detour is not None:
        # Halfway, the two inner control points of a cubic have a weight of 3/4 together.
        over_start = over_goal = (path.detour - 0.125 * (first + above)) / 0.75
    return np.stack([first, over_start + deviation, over_goal + deviation * np.array([0.6, 0.6, 1.0]), above])


def _with_release(object_poses: Float64[np.ndarray, "frames 4 4"], frames: int) -> ScriptedMotion:
    time = np.arange(frames) / frames
    opening = np.clip((time - HOLD - CARRY - LOWER) / RELEASE, 0, 1)
    retreated = np.clip((time - HOLD - CARRY - LOWER - RELEASE) / (1 - HOLD - CARRY - LOWER - RELEASE), 0, 1)
    return ScriptedMotion(object_poses, opening == 0, opening, 0.10 * minimum_jerk(0.7 * retreated))


def _tremor(frames: int, width: int, rng: np.random.Generator) -> Float64[np.ndarray, "frames width"]:
    """Return sums of slow sine waves of random phases, the part of a tremor that 30 frames per second show."""
    seconds = np.arange(frames)[:, None] / 30
    waves = np.zeros((frames, width))
    for hertz in (0.7, 1.3, 2.3, 4.1):
        waves += np.sin(2 * math.pi * hertz * seconds + rng.uniform(0, 2 * math.pi, width)) / math.sqrt(2)
    return waves
