"""Insertion: a long block goes from above into the slot of a holder, whose print it completes."""

from typing import ClassVar, final

import cv2
import mujoco
import numpy as np
from jaxtyping import UInt8

from geoskill.geometry.poses import Pose, pose, rotation_about, table_pose
from geoskill.simulation.actors.actor import Grip
from geoskill.simulation.roles import SceneRole
from geoskill.simulation.shapes import add_box, add_cylinder, add_material, add_mocap_body, add_printed_box
from geoskill.simulation.tasks.task import PlanarPose, RigidObject, RolePart, Task, TaskScene
from geoskill.simulation.textures import cut_card, print_on_card, striped_print

Picture = UInt8[np.ndarray, "height width 3"]
Cutout = UInt8[np.ndarray, "cutout_height cutout_width 3"]

HALF_BLOCK = (0.019, 0.075, 0.017)
# The holder's frame is on the table. Its slot is open at the top, and at the back, where the block is held.
HALF_HOLDER = (0.054, 0.066)
HALF_SLOT = 0.020
STOP = 0.038  # length of the wall that closes the slot in front
FLOOR = 0.006
TOP = FLOOR + 2 * HALF_BLOCK[2]  # the block ends flush with the holder
GAP = 0.001
# The printed sheet from which the tops of block and holder are cut: a square above both, from NEAR on along y.
NEAR = -HALF_HOLDER[1]
SHEET = STOP + GAP + 2 * HALF_BLOCK[1]
OBJECT, TARGET = "block", "holder"


@final
class Insertion(Task):
    """A task whose block and holder are printed with one sheet, with stripes that the inserted block completes."""

    name: ClassVar[str] = "insertion"

    def build(
        self,
        spec: mujoco.MjSpec,
        target: PlanarPose,
        start: PlanarPose,
        appearance_rng: np.random.Generator,
        episode_rng: np.random.Generator,
    ) -> TaskScene:
        """See :meth:`Task.build`."""
        holder = table_pose(-0.085 + target.x, 0.005 + target.y, 0.12 + target.yaw_rad)
        goal = holder @ pose((0.0, NEAR + STOP + GAP + HALF_BLOCK[1], FLOOR + HALF_BLOCK[2]))
        paper = tuple(appearance_rng.uniform(190, 225, 3))
        along = 0.5 + (np.array([-0.008, 0.008]) + appearance_rng.uniform(-0.001, 0.001, 2)) / SHEET
        across = 1 - (STOP + np.array([0.020, 0.068]) + appearance_rng.uniform(-0.006, 0.006, 2)) / SHEET
        sheet = striped_print(appearance_rng, paper, tuple(along), tuple(across))
        # The holder's paper is darker than the block's, whose edges should remain visible in the slot.
        _add_holder(spec, holder, (sheet * appearance_rng.uniform(0.82, 0.94, 3)).astype(np.uint8), appearance_rng)
        _add_block(spec, sheet, appearance_rng)
        _add_distractors(spec, appearance_rng)
        # Only the part that protrudes from the slot at the back can be held.
        grip_pose = pose(
            (0.0, episode_rng.uniform(0.046, 0.053), episode_rng.uniform(0.006, 0.010)),
            rotation_about(np.array([episode_rng.uniform(0.15, 0.3), 0.0, 0.0])),
        )
        corners = [(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (0.0, TOP)]
        extent = np.array([[x * HALF_HOLDER[0], y * HALF_HOLDER[1], z] for x, y, z in corners])
        return TaskScene(
            start=table_pose(0.175 + start.x, -0.045 + start.y, -0.2 + start.yaw_rad, HALF_BLOCK[2] + 0.001),
            goal=goal,
            approach=np.array([0.0, 0.0, 0.06]),
            height=0.06,
            grip=Grip(grip_pose, HALF_BLOCK[0]),
            dynamics=RigidObject(OBJECT),
            extent=extent - np.array([0.0, NEAR + STOP + GAP + HALF_BLOCK[1], FLOOR + HALF_BLOCK[2]]),
            roles=(RolePart(OBJECT, SceneRole.OBJECT), RolePart(TARGET, SceneRole.TARGET)),
        )


def _add_holder(spec: mujoco.MjSpec, holder: Pose, sheet: Picture, appearance_rng: np.random.Generator) -> None:
    """Add the holder: a floor, two cheeks and the stop, the latter three with their parts of the sheet on top."""
    half_x, half_y = HALF_HOLDER
    cheek = (half_x - HALF_SLOT) / 2
    body = add_mocap_body(spec, TARGET, holder)
    wall = (0.30, 0.27, 0.25)
    add_box(body, (HALF_SLOT, half_y, FLOOR / 2), pose((0, 0, FLOOR / 2)), color=wall)
    front = cut_card(print_on_card(appearance_rng, (205, 200, 190), 16), (2 * half_x, TOP))
    scale = front.shape[1] / (2 * half_x)
    for name, center, half_width, far in (
        ("left", -HALF_SLOT - cheek, cheek, half_y),
        ("stop", 0.0, HALF_SLOT, NEAR + STOP),
        ("right", HALF_SLOT + cheek, cheek, half_y),
    ):
        x = (center - half_width, center + half_width)
        columns = slice(round((x[0] + half_x) * scale), round((x[1] + half_x) * scale))
        faces = {
            "+z": add_material(spec, f"holder_{name}", _cut(sheet, x, (NEAR, far))),
            "-y": add_material(spec, f"holder_{name}_front", front[:, columns]),
        }
        half_length = (far - NEAR) / 2
        part_pose = pose((center, NEAR + half_length, TOP / 2))
        add_printed_box(body, (half_width, half_length, TOP / 2), faces, wall, part_pose)


def _add_block(spec: mujoco.MjSpec, sheet: Picture, appearance_rng: np.random.Generator) -> None:
    half_x, half_y, half_z = HALF_BLOCK
    near = NEAR + STOP + GAP
    faces = {"+z": add_material(spec, "block_top", _cut(sheet, (-half_x, half_x), (near, near + 2 * half_y)))}
    for face, half_width in (("-y", half_x), ("+x", half_y), ("-x", half_y)):
        side = cut_card(print_on_card(appearance_rng, (225, 205, 160), 24), (2 * half_width, 2 * half_z))
        faces[face] = add_material(spec, f"block{face}", side)
    add_printed_box(add_mocap_body(spec, OBJECT), HALF_BLOCK, faces, (0.62, 0.52, 0.40), np.eye(4))


def _add_distractors(spec: mujoco.MjSpec, appearance_rng: np.random.Generator) -> None:
    """Add a shorter block, a card and a tin, away from the path and from all placements of the target."""
    placements = (
        ("bar", (0.045, 0.014, 0.012), table_pose(0.03, -0.185, 0.25, 0.012)),
        ("card", (0.050, 0.032, 0.001), table_pose(-0.265, 0.20, -0.3, 0.001)),
    )
    for name, half_size, body_pose in placements:
        paper = tuple(appearance_rng.uniform(120, 200, 3))
        card = print_on_card(appearance_rng, paper, 14, 0.8)
        faces = {"+z": add_material(spec, name, cut_card(card, (2 * half_size[0], 2 * half_size[1])))}
        edge = tuple(np.array(paper) / 300)
        add_printed_box(add_mocap_body(spec, f"distractor_{name}", body_pose), half_size, faces, edge, np.eye(4))
    tin = add_mocap_body(spec, "distractor_tin", table_pose(-0.23, -0.13, 0.0))
    color = tuple(appearance_rng.uniform(0.2, 0.7, 3))
    add_cylinder(tin, (0, 0, 0), (0, 0, 0.030), 0.020, color=color)


def _cut(sheet: Picture, x: tuple[float, float], y: tuple[float, float]) -> Cutout:
    """Return the part of the sheet above a rectangle of the holder's frame, with a border that clarifies its edges."""
    scale = len(sheet) / SHEET
    left, right = (round((value + SHEET / 2) * scale) for value in x)
    bottom, top = (round((value - NEAR) * scale) for value in y)
    part = sheet[len(sheet) - top : len(sheet) - bottom, left:right].copy()
    cv2.rectangle(part, (0, 0), (right - left - 1, top - bottom - 1), (40.0, 40.0, 50.0), 7)
    return part
