"""Flush: a box is laid beside a plate on a slanted stand, so that the upper faces of both are in one plane."""

import math
from typing import ClassVar, final

import mujoco
import numpy as np

from geoskill.geometry.poses import Pose, pose, rotation_about, table_pose
from geoskill.simulation.actors.actor import Grip
from geoskill.simulation.roles import SceneRole
from geoskill.simulation.shapes import add_box, add_cylinder, add_material, add_mocap_body, add_printed_box
from geoskill.simulation.tasks.task import PlanarPose, RigidObject, RolePart, Task, TaskScene
from geoskill.simulation.textures import cut_card, print_on_card, wood

# The stand's frame is in the middle of its upper face; x is up the slope, toward the box's start, and y away from the
# camera. On a level face everything on the table would be flush from the start, and on one that leans toward the camera
# nearly so; this one's plane passes far above the box. The box lies against the plate, which is below it.
TILT_RAD = math.radians(20)
HALF_STAND = (0.112, 0.062, 0.006)
# The box is longer than the plate and as thick; it is held behind the plate, where fingers have room beside it.
HALF_PLATE = (0.050, 0.034, 0.016)
HALF_BOX = (0.036, 0.054, 0.016)
GAP = 0.001
FRONT = -0.055  # y at which plate and box begin
PLATE_CENTER = (-HALF_PLATE[0], FRONT + HALF_PLATE[1], HALF_PLATE[2])
BOX_CENTER = (GAP + HALF_BOX[0], FRONT + HALF_BOX[1], HALF_BOX[2])
OBJECT, TARGET = "box", "plate"


@final
class Flush(Task):
    """A task with a printed plate on a stand, and a printed box that becomes flush with it, above and in front."""

    name: ClassVar[str] = "flush"

    def build(
        self,
        spec: mujoco.MjSpec,
        target: PlanarPose,
        start: PlanarPose,
        appearance_rng: np.random.Generator,
        episode_rng: np.random.Generator,
    ) -> TaskScene:
        """See :meth:`Task.build`."""
        lean = rotation_about(np.array([0.0, -TILT_RAD, 0.0]))
        height = HALF_STAND[0] * math.sin(TILT_RAD) + 2 * HALF_STAND[2] * math.cos(TILT_RAD)
        stand = table_pose(-0.075 + target.x, 0.0 + target.y, 0.08 + target.yaw_rad, height) @ pose((0, 0, 0), lean)
        _add_stand(spec, stand, height, appearance_rng)
        paper = tuple(appearance_rng.uniform(190, 235, 3))
        _add_printed(spec, TARGET, HALF_PLATE, paper, stand @ pose(PLATE_CENTER), appearance_rng)
        paper = tuple(appearance_rng.uniform(190, 235, 3))
        _add_printed(spec, OBJECT, HALF_BOX, paper, np.eye(4), appearance_rng)
        _add_distractors(spec, appearance_rng)
        grip_pose = pose(
            (0.0, episode_rng.uniform(0.026, 0.032), episode_rng.uniform(0.006, 0.010)),
            rotation_about(np.array([episode_rng.uniform(0.0, 0.15), 0.0, episode_rng.uniform(-0.05, 0.1)])),
        )
        corners = [(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]
        return TaskScene(
            start=table_pose(0.19 + start.x, -0.055 + start.y, -0.15 + start.yaw_rad, HALF_BOX[2] + 0.001),
            goal=stand @ pose(BOX_CENTER),
            approach=np.array([0.0, 0.0, 0.055]),
            height=0.06,
            grip=Grip(grip_pose, HALF_BOX[0]),
            dynamics=RigidObject(OBJECT),
            extent=np.array(corners) * HALF_PLATE + PLATE_CENTER - np.array(BOX_CENTER),
            roles=(RolePart(OBJECT, SceneRole.OBJECT), RolePart(TARGET, SceneRole.TARGET)),
        )


def _add_stand(spec: mujoco.MjSpec, stand: Pose, height: float, appearance_rng: np.random.Generator) -> None:
    """Add the stand: a slanted board, and a foot that carries its upper end."""
    board = add_material(spec, "stand", wood(appearance_rng, (134, 112, 88), 5.0))
    body = add_mocap_body(spec, "stand", stand)
    half_x, half_y, half_z = HALF_STAND
    add_box(body, HALF_STAND, pose((0, 0, -half_z)), board)
    upright = rotation_about(np.array([0.0, TILT_RAD, 0.0]))
    end = pose((0.8 * half_x, 0, -half_z)) @ pose((0, 0, 0), upright)
    rise = height / 2 + 0.4 * half_x * math.sin(TILT_RAD) - half_z
    add_box(body, (0.006, half_y, rise), end @ pose((0, 0, -rise)), color=(0.40, 0.33, 0.26))


def _add_printed(
    spec: mujoco.MjSpec,
    name: str,
    half_size: tuple[float, float, float],
    paper: tuple[float, ...],
    body_pose: Pose,
    appearance_rng: np.random.Generator,
) -> None:
    """Add a box with a print of many shapes on top, and of fewer on the sides that the camera sees."""
    half_x, half_y, half_z = half_size
    faces = {}
    for side, half_width, half_height, shapes in (
        ("+z", half_x, half_y, 44),
        ("-y", half_x, half_z, 16),
        ("+x", half_y, half_z, 12),
        ("-x", half_y, half_z, 12),
    ):
        card = print_on_card(appearance_rng, paper, shapes)
        faces[side] = add_material(spec, f"{name}{side}", cut_card(card, (2 * half_width, 2 * half_height)))
    add_printed_box(add_mocap_body(spec, name, body_pose), half_size, faces, tuple(np.array(paper) / 320), np.eye(4))


def _add_distractors(spec: mujoco.MjSpec, appearance_rng: np.random.Generator) -> None:
    """Add an upright sign, a card and a tin, away from the path and from all placements of the target."""
    for name, half_size, face, body_pose in (
        ("sign", (0.024, 0.006, 0.024), "-y", table_pose(-0.28, 0.19, 0.5, 0.024)),
        ("card", (0.048, 0.034, 0.001), "+z", table_pose(0.0, -0.19, 0.2, 0.001)),
    ):
        paper = tuple(appearance_rng.uniform(120, 200, 3))
        height = half_size[2] if face == "-y" else half_size[1]
        card = cut_card(print_on_card(appearance_rng, paper, 14, 0.8), (2 * half_size[0], 2 * height))
        body = add_mocap_body(spec, f"distractor_{name}", body_pose)
        faces = {face: add_material(spec, name, card)}
        add_printed_box(body, half_size, faces, tuple(np.array(paper) / 300), np.eye(4))
    tin = add_mocap_body(spec, "distractor_tin", table_pose(-0.24, -0.17, 0.0))
    add_cylinder(tin, (0, 0, 0), (0, 0, 0.026), 0.022, color=tuple(appearance_rng.uniform(0.2, 0.7, 3)))
