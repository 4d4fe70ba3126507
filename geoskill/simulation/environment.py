"""The room: table, lamps, and what passes between the camera and the scene."""

import math
from dataclasses import dataclass
from typing import final

import mujoco
import numpy as np
from jaxtyping import Float64

from geoskill.geometry.camera import PinholeCamera, back_project, project
from geoskill.geometry.poses import Pose, inverse, pose, transform
from geoskill.simulation.parts import add_box, add_printed_box, moving_body, textured
from geoskill.simulation.textures import felt, print_on_card, stone, wood

PASSER_BY = "passer_by"
HALF_COVER = 0.3
# Beside the picture, far enough for its shadow not to be seen.
AWAY_PX = 700.0
# Where between the camera (0) and what it hides (1) something passes.
PASSING_AT = 0.55


def add_table(spec: mujoco.MjSpec, random: np.random.Generator) -> None:
    """A table top of wood, felt or stone, of a color of its own."""
    tone = random.uniform(95, 185)
    color = tuple(float(np.clip(tone + shift, 60, 210)) for shift in random.normal(0, 16, 3))
    surface = (wood, felt, stone)[random.integers(3)](random, color)
    surface = np.pad(surface, ((0, len(surface)), (0, len(surface)), (0, 0)), "symmetric")  # repeats without a seam
    material = textured(spec, "table", surface, (1.1, 1.1), per_meter=True, shine=0.05)
    table = spec.worldbody.add_body(name="table")
    add_box(table, (1.6, 1.6, 0.02), pose((0.0, 0.0, -0.02)), material)


def add_light(spec: mujoco.MjSpec, dark: float, random: np.random.Generator) -> None:
    """Lamps of the room, and one that can be moved about.

    Args:
        spec: the scene.
        dark: 0 for the usual room, 1 for one that only the moved lamp lights.
        random: draws where the lamps are and how bright.
    """
    level = (1 - dark) * random.uniform(0.95, 1.05)
    spec.visual.headlight.ambient = [0.22 * level + 0.03 * dark] * 3
    spec.visual.headlight.diffuse = [0.10 * level] * 3
    spec.visual.headlight.specular = [0.0] * 3
    if level > 0:
        for x, y, strength, shadow in ((-0.5, 0.3, 0.55, True), (0.7, -0.5, 0.30, False)):
            where = np.array([x, y, 1.5]) + random.uniform(-0.1, 0.1, 3)
            spec.worldbody.add_light(
                name=f"lamp{x}",
                pos=where,
                dir=-where,
                type=mujoco.mjtLightType.mjLIGHT_DIRECTIONAL,
                diffuse=[strength * level] * 3,
                specular=[0.2] * 3,
                castshadow=shadow,
            )
    if dark > 0:
        lamp = moving_body(spec, "lamp")
        lamp.add_light(
            name="moved",
            pos=[0, 0, 0],
            dir=[0, 0, -1],
            type=mujoco.mjtLightType.mjLIGHT_SPOT,
            cutoff=75,
            exponent=2,
            attenuation=[1.0, 0.0, 1.5],
            diffuse=[0.8 * dark] * 3,
            specular=[0.3] * 3,
            castshadow=True,
        )


def lamp_course(frames: int, random: np.random.Generator) -> Float64[np.ndarray, "frames 4 4"]:
    """Where the moved lamp is: on an arc over the table."""
    start, turn = random.uniform(0, 2 * math.pi), random.choice([-1, 1]) * random.uniform(0.6, 0.9) * 2 * math.pi
    course = []
    for share in np.linspace(0, 1, frames):
        angle = start + share * turn
        course.append(pose((0.35 * math.cos(angle), 0.30 * math.sin(angle), 0.65)))
    return np.stack(course)


def add_passer_by(spec: mujoco.MjSpec, looks: np.random.Generator) -> None:
    """A folder of prints, held upright."""
    color = tuple(looks.uniform(60, 200, 3))
    cover = textured(spec, "cover", print_on_card(looks, color, 5, 0.4))
    body = moving_body(spec, PASSER_BY)
    add_printed_box(body, (HALF_COVER, HALF_COVER, 0.02), {"+z": cover}, (0.4, 0.35, 0.3), np.eye(4))


@final
@dataclass(frozen=True)
class Passing:
    """How something passes.

    Attributes:
        hidden: the share of what it passes before that it covers, at its farthest.
        begin: share of the recording at which it begins to come.
        end: share at which it is gone.
    """

    hidden: float
    begin: float
    end: float


def passing_course(
    camera: Float64[np.ndarray, "frames 4 4"],
    lens: PinholeCamera,
    outline: Float64[np.ndarray, "corners 3"],
    passing: Passing,
    side: float,
) -> Float64[np.ndarray, "frames 4 4"]:
    """Poses of what passes: it comes in from one side of the picture, stays before the target, and goes back.

    Args:
        camera: poses of the camera.
        lens: the camera, of whatever pose.
        outline: corners of what is to be hidden, in the world.
        passing: how much and when.
        side: from which side of the picture, 1 the right, -1 the left.
    """
    course = []
    for share, matrix in zip(np.linspace(0, 1, len(camera)), camera, strict=True):
        view = PinholeCamera(lens.width, lens.height, lens.focal_px, matrix)
        pixels, depth = project(view, outline)
        near, far = (pixels[:, 0].max(), pixels[:, 0].min()) if side > 0 else (pixels[:, 0].min(), pixels[:, 0].max())
        covering = near + passing.hidden * (far - near)
        away = lens.width - 1 + AWAY_PX if side > 0 else -AWAY_PX
        course.append(_before(view, away + _presence(share, passing) * (covering - away), depth.mean(), side))
    return np.stack(course)


def _presence(share: float, passing: Passing) -> float:
    """0 when it is away, 1 when it covers most: in, for long there, and out."""
    within = (share - passing.begin) / (passing.end - passing.begin)
    if not 0 < within < 1:
        return 0.0
    edge = min(within, 1 - within) / 0.18
    return min(1.0, edge) ** 2 * (3 - 2 * min(1.0, edge))


def _before(view: PinholeCamera, edge_px: float, depth: float, side: float) -> Pose:
    """The pose in which the upright folder's near edge appears at a column of the picture."""
    distance = PASSING_AT * depth
    middle_row = view.center_px[1]
    edge = transform(inverse(view.pose), back_project(view, np.array([[edge_px, middle_row]]), np.array([distance])))[0]
    # Faces the camera; half as wide as the body is.
    return np.asarray(view.pose @ pose((edge[0] + side * HALF_COVER, edge[1], distance), np.diag([1.0, -1.0, -1.0])))
