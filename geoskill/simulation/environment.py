"""The environment: table, lamps, and an occluder that passes between the camera and the scene."""

import math
from dataclasses import dataclass
from typing import final

import mujoco
import numpy as np
from jaxtyping import Float64

from geoskill.geometry.camera import PinholeCamera, back_project, project
from geoskill.geometry.poses import Pose, inverse, pose, transform
from geoskill.simulation.shapes import add_box, add_material, add_mocap_body, add_printed_box
from geoskill.simulation.textures import felt, print_on_card, stone, wood

# Names of bodies, which recordings contain.
OCCLUDER, LAMP = "passer_by", "lamp"
OCCLUDER_HALF_SIZE = 0.3
# Distance of the waiting occluder from the image, so that not even its shadow is visible.
AWAY_PX = 700.0
# Position of the occluder between the camera (0) and the outline that it hides (1).
OCCLUDER_DEPTH_RATIO = 0.55


def add_table(spec: mujoco.MjSpec, rng: np.random.Generator) -> None:
    """Add a table top at z = 0, of wood, felt or stone in a random color."""
    tone = rng.uniform(95, 185)
    color = tuple(float(np.clip(tone + shift, 60, 210)) for shift in rng.normal(0, 16, 3))
    surface = (wood, felt, stone)[rng.integers(3)](rng, color)
    surface = np.pad(surface, ((0, len(surface)), (0, len(surface)), (0, 0)), "symmetric")  # repeats without a seam
    material = add_material(spec, "table", surface, (1.1, 1.1), per_meter=True, shine=0.05)
    table = spec.worldbody.add_body(name="table")
    add_box(table, (1.6, 1.6, 0.02), pose((0.0, 0.0, -0.02)), material)


def add_light(spec: mujoco.MjSpec, darkness: float, rng: np.random.Generator) -> None:
    """Add the lamps of the room, and in a darkened room one that moves.

    Args:
        spec: the scene.
        darkness: from 0 for the usual room, without the moving lamp, to 1 for a room that only this lamp lights.
        rng: draws the brightness of the room and the positions of its lamps.
    """
    level = (1 - darkness) * rng.uniform(0.95, 1.05)
    spec.visual.headlight.ambient = [0.22 * level + 0.03 * darkness] * 3
    spec.visual.headlight.diffuse = [0.10 * level] * 3
    spec.visual.headlight.specular = [0.0] * 3
    if level > 0:
        for x, y, strength, shadow in ((-0.5, 0.3, 0.55, True), (0.7, -0.5, 0.30, False)):
            position = np.array([x, y, 1.5]) + rng.uniform(-0.1, 0.1, 3)
            spec.worldbody.add_light(
                name=f"lamp{x}",
                pos=position,
                dir=-position,
                type=mujoco.mjtLightType.mjLIGHT_DIRECTIONAL,
                diffuse=[strength * level] * 3,
                specular=[0.2] * 3,
                castshadow=shadow,
            )
    if darkness > 0:
        lamp = add_mocap_body(spec, LAMP)
        lamp.add_light(
            name="moved",
            pos=[0, 0, 0],
            dir=[0, 0, -1],
            type=mujoco.mjtLightType.mjLIGHT_SPOT,
            cutoff=75,
            exponent=2,
            attenuation=[1.0, 0.0, 1.5],
            diffuse=[0.8 * darkness] * 3,
            specular=[0.3] * 3,
            castshadow=True,
        )


def lamp_trajectory(frames: int, rng: np.random.Generator) -> Float64[np.ndarray, "frames 4 4"]:
    """Return the moving lamp's pose on every frame, on an arc above the table."""
    start, turn = rng.uniform(0, 2 * math.pi), rng.choice([-1, 1]) * rng.uniform(0.6, 0.9) * 2 * math.pi
    trajectory = []
    for time in np.linspace(0, 1, frames):
        angle = start + time * turn
        trajectory.append(pose((0.35 * math.cos(angle), 0.30 * math.sin(angle), 0.65)))
    return np.stack(trajectory)


def add_occluder(spec: mujoco.MjSpec, appearance_rng: np.random.Generator) -> None:
    """Add the occluder, an upright printed folder."""
    color = tuple(appearance_rng.uniform(60, 200, 3))
    cover = add_material(spec, "cover", print_on_card(appearance_rng, color, 5, 0.4))
    body = add_mocap_body(spec, OCCLUDER)
    half_size = (OCCLUDER_HALF_SIZE, OCCLUDER_HALF_SIZE, 0.02)
    add_printed_box(body, half_size, {"+z": cover}, (0.4, 0.35, 0.3), np.eye(4))


@final
@dataclass(frozen=True)
class Occlusion:
    """Extent and time of an occlusion.

    Attributes:
        coverage: the largest share of the outline's width that the occluder hides.
        begin: share of the recording at which the occluder begins to move in.
        end: share of the recording at which it is gone.
    """

    coverage: float
    begin: float
    end: float


def occluder_trajectory(
    camera_poses: Float64[np.ndarray, "frames 4 4"],
    intrinsics: PinholeCamera,
    outline: Float64[np.ndarray, "corners 3"],
    occlusion: Occlusion,
    side: float,
) -> Float64[np.ndarray, "frames 4 4"]:
    """Return the occluder's pose on every frame: it moves in from one side, stays in front of the outline, and leaves.

    Args:
        camera_poses: poses of the camera.
        intrinsics: the camera at any pose.
        outline: corners of the things to be hidden, in the world.
        occlusion: extent and time.
        side: of the image from which the occluder comes, 1 for the right, -1 for the left.
    """
    trajectory = []
    for time, camera_pose in zip(np.linspace(0, 1, len(camera_poses)), camera_poses, strict=True):
        view = PinholeCamera(intrinsics.width, intrinsics.height, intrinsics.focal_px, camera_pose)
        pixels, depth = project(view, outline)
        near, far = (pixels[:, 0].max(), pixels[:, 0].min()) if side > 0 else (pixels[:, 0].min(), pixels[:, 0].max())
        covering = near + occlusion.coverage * (far - near)
        away = intrinsics.width - 1 + AWAY_PX if side > 0 else -AWAY_PX
        edge_px = away + _presence(time, occlusion) * (covering - away)
        trajectory.append(_occluder_pose(view, edge_px, depth.mean(), side))
    return np.stack(trajectory)


def _presence(time: float, occlusion: Occlusion) -> float:
    """Return 0 while the occluder is away and 1 while it covers most, with smooth transitions."""
    within = (time - occlusion.begin) / (occlusion.end - occlusion.begin)
    if not 0 < within < 1:
        return 0.0
    ramp = min(within, 1 - within) / 0.18
    return min(1.0, ramp) ** 2 * (3 - 2 * min(1.0, ramp))


def _occluder_pose(view: PinholeCamera, edge_px: float, depth: float, side: float) -> Pose:
    """Return the pose that faces the camera and shows the occluder's leading edge at a column of the image."""
    distance = OCCLUDER_DEPTH_RATIO * depth
    center_row = view.center_px[1]
    edge = transform(inverse(view.pose), back_project(view, np.array([[edge_px, center_row]]), np.array([distance])))[0]
    in_camera = pose((edge[0] + side * OCCLUDER_HALF_SIZE, edge[1], distance), np.diag([1.0, -1.0, -1.0]))
    return np.asarray(view.pose @ in_camera)
