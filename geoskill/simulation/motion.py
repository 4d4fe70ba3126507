"""How the object is led from its start to its goal: like a person does it, or like a robot."""

import math
from dataclasses import dataclass
from typing import final

import numpy as np
from jaxtyping import Float64

from geoskill.geometry.poses import Pose, rotation_about, rotation_vector

Course = Float64[np.ndarray, " frames"]

# Shares of the recording: held at the start, carried, penalized, let go, drawn back.
HOLD, CARRY, LOWER, RELEASE = 0.05, 0.62, 0.18, 0.05


@final
@dataclass(frozen=True, eq=False)
class Displacement:
    """Where the carried thing and the actor are on every frame.

    Attributes:
        led: poses of the carried thing.
        held: whether the actor still holds it.
        opening: of the fingers, from 0 to 1.
        retreat: how far the actor has drawn back, in meters.
    """

    led: Float64[np.ndarray, "frames 4 4"]
    held: np.ndarray
    opening: Course
    retreat: Course


@final
@dataclass(frozen=True, eq=False)
class Way:
    """Where the motion has to go.

    Attributes:
        start: first pose of the carried thing.
        goal: last pose.
        approach: from the goal to where the last straight stretch begins, meters.
        height: how high the path rises over the higher of its ends, meters.
        detour: a place that the path passes halfway instead of the straight way, if any.
    """

    start: Pose
    goal: Pose
    approach: Float64[np.ndarray, "3"]
    height: float
    detour: Float64[np.ndarray, "3"] | None = None


def human_motion(way: Way, frames: int, confidence: float, random: np.random.Generator) -> Displacement:
    """A curved path at a smooth speed (minimum jerk), with the jitter of a hand.

    Args:
        way: where to go.
        frames: how many to make.
        confidence: in (0, 1]; the less, the larger the detours, hesitations and jitter.
        random: draws path, speed and jitter.
    """
    doubt = 1.0 - confidence
    side = random.normal(0, 1, 3) * np.array([1.0, 1.0, 0.5]) * (0.018 + 0.12 * doubt)
    carried = minimum_jerk(np.linspace(0, 1, max(2, round(CARRY * frames))) ** random.uniform(0.8, 1.15))
    pauses = np.sin(2 * math.pi * random.integers(2, 4) * carried) * np.sin(math.pi * carried)
    carried = np.clip(carried + 0.35 * doubt * pauses, 0, 1)
    led = _path(way, carried, frames, side)
    tremble = 0.0006 + 0.006 * doubt
    # A hand at rest on the table does not tremble.
    strength = np.sin(math.pi * np.clip(np.linspace(0, 1, frames) / (HOLD + CARRY + LOWER), 0, 1))[:, None]
    shift = tremble * strength * _smooth(frames, 3, random)
    turn = 6 * tremble / 0.1 * strength * _smooth(frames, 3, random)
    for matrix, by, about in zip(led, shift, turn, strict=True):
        matrix[:3, 3] += by * np.array([1.0, 1.0, 0.4])
        matrix[:3, :3] = rotation_about(about) @ matrix[:3, :3]
    return _with_release(led, frames)


def robot_motion(way: Way, frames: int) -> Displacement:
    """A path at a speed that rises, stays and falls, without jitter."""
    share = np.linspace(0, 1, max(2, round(CARRY * frames)))
    ramp = 0.25
    rising = np.minimum(share, ramp) ** 2 / (2 * ramp)
    level = np.clip(share - ramp, 0, 1 - 2 * ramp)
    falling = np.clip(share - (1 - ramp), 0, ramp)
    carried = (rising + level + falling - falling**2 / (2 * ramp)) / (1 - ramp)
    return _with_release(_path(way, carried, frames, np.zeros(3)), frames)


def minimum_jerk(share: Course) -> Course:
    """The course of a human reach from 0 to 1 (Flash and Hogan, 1985).

    >>> minimum_jerk(np.array([0.0, 0.5, 1.0]))
    array([0. , 0.5, 1. ])
    """
    return np.asarray(10 * share**3 - 15 * share**4 + 6 * share**5)


def _path(
    way: Way, carried: Float64[np.ndarray, " carried"], frames: int, side: Float64[np.ndarray, "3"]
) -> Float64[np.ndarray, "frames 4 4"]:
    """Start, a curve to above the goal, a straight stretch onto it, rest."""
    first, last = way.start[:3, 3], way.goal[:3, 3]
    above = last + way.approach
    top = max(first[2], above[2]) + way.height
    over_start = np.array([*(0.75 * first[:2] + 0.25 * above[:2]), top])
    over_goal = np.array([*(0.25 * first[:2] + 0.75 * above[:2]), top])
    if way.detour is not None:
        # A cubic passes at 3/4 of the way to its inner control points, halfway.
        over_start = over_goal = (way.detour - 0.125 * (first + above)) / 0.75
    controls = np.stack([first, over_start + side, over_goal + side * np.array([0.6, 0.6, 1.0]), above])
    if way.detour is not None:
        # Slow where it is farthest away.
        carried = carried + 0.85 * np.sin(2 * math.pi * carried) / (2 * math.pi)
    share = carried[:, None]
    curve = (
        (1 - share) ** 3 * controls[0]
        + 3 * (1 - share) ** 2 * share * controls[1]
        + 3 * (1 - share) * share**2 * controls[2]
        + share**3 * controls[3]
    )
    penalized = minimum_jerk(np.linspace(0, 1, max(2, round(LOWER * frames))))[:, None]
    held = np.repeat(first[None], round(HOLD * frames), axis=0)
    places = np.concatenate([held, curve, above + penalized * (last - above)])[:frames]
    places = np.concatenate([places, np.repeat(last[None], frames - len(places), axis=0)])
    turn = rotation_vector(way.goal[:3, :3] @ way.start[:3, :3].T)
    turned = np.concatenate([np.zeros(len(held)), carried])[:frames]
    turned = np.concatenate([turned, np.ones(frames - len(turned))])
    led = np.repeat(np.eye(4)[None], frames, axis=0)
    led[:, :3, 3] = places
    for matrix, part in zip(led, turned, strict=True):
        matrix[:3, :3] = rotation_about(part * turn) @ way.start[:3, :3]
    return led


def _with_release(led: Float64[np.ndarray, "frames 4 4"], frames: int) -> Displacement:
    time = np.arange(frames) / frames
    opening = np.clip((time - HOLD - CARRY - LOWER) / RELEASE, 0, 1)
    back = np.clip((time - HOLD - CARRY - LOWER - RELEASE) / (1 - HOLD - CARRY - LOWER - RELEASE), 0, 1)
    return Displacement(led, opening == 0, opening, 0.10 * minimum_jerk(0.7 * back))


def _smooth(frames: int, width: int, random: np.random.Generator) -> Float64[np.ndarray, "frames width"]:
    """Sums of slow waves of random phase, of RMS 1: what is left of tremor at 30 frames per second."""
    seconds = np.arange(frames)[:, None] / 30
    waves = np.zeros((frames, width))
    for hertz in (0.7, 1.3, 2.3, 4.1):
        waves += np.sin(2 * math.pi * hertz * seconds + random.uniform(0, 2 * math.pi, width)) / math.sqrt(2)
    return waves
