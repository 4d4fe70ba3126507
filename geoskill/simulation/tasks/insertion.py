"""A long block goes from above into the slot of a holder, whose print it completes."""

from typing import final

import cv2
import mujoco
import numpy as np
from jaxtyping import UInt8

from geoskill.geometry.poses import Pose, pose, rotation_about, table_pose
from geoskill.simulation.actors.actor import Grip
from geoskill.simulation.parts import add_box, add_cylinder, add_printed_box, moving_body, textured
from geoskill.simulation.roles import SceneRole
from geoskill.simulation.tasks.task import Rigid, RolePart, TablePlace, Task, TaskScene
from geoskill.simulation.textures import print_on_card, striped_print

Picture = UInt8[np.ndarray, "height width 3"]
Part = UInt8[np.ndarray, "part_height part_width 3"]

HALF_BLOCK = (0.019, 0.075, 0.017)
# The holder's frame is on the table; its slot is open above and behind, where the block is held.
HALF_HOLDER = (0.054, 0.066)
HALF_SLOT = 0.020
STOP = 0.038  # what closes the slot in front
FLOOR = 0.006
TOP = FLOOR + 2 * HALF_BLOCK[2]  # the block ends flush with the holder
GAP = 0.001
# The sheet that is cut into the tops of block and holder: a square over both, in the holder's frame.
NEAR = -HALF_HOLDER[1]
SHEET = STOP + GAP + 2 * HALF_BLOCK[1]
OBJECT, TARGET = "block", "holder"


@final
class Insertion(Task):
    """The tops of block and holder are cut out of one printed sheet: in the slot, its stripes are whole again."""

    @property
    def name(self) -> str:
        """See :attr:`Task.name`."""
        return "insertion"

    def build(
        self,
        spec: mujoco.MjSpec,
        target: TablePlace,
        start: TablePlace,
        looks: np.random.Generator,
        take: np.random.Generator,
    ) -> TaskScene:
        """See :meth:`Task.build`."""
        holder = table_pose(-0.085 + target.x, 0.005 + target.y, 0.12 + target.yaw_rad)
        goal = holder @ pose((0.0, NEAR + STOP + GAP + HALF_BLOCK[1], FLOOR + HALF_BLOCK[2]))
        paper = tuple(looks.uniform(190, 225, 3))
        along = 0.5 + (np.array([-0.008, 0.008]) + looks.uniform(-0.001, 0.001, 2)) / SHEET
        across = 1 - (STOP + np.array([0.020, 0.068]) + looks.uniform(-0.006, 0.006, 2)) / SHEET
        sheet = striped_print(looks, paper, tuple(along), tuple(across))
        # On darker paper than the block's, whose edges are to be seen in the slot, too.
        _add_holder(spec, holder, (sheet * looks.uniform(0.82, 0.94, 3)).astype(np.uint8), looks)
        _add_block(spec, sheet, looks)
        _add_distractors(spec, looks)
        # Only what stands out of the slot behind can be held.
        held_at = pose(
            (0.0, take.uniform(0.046, 0.053), take.uniform(0.006, 0.010)),
            rotation_about(np.array([take.uniform(0.15, 0.3), 0.0, 0.0])),
        )
        corners = [(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (0.0, TOP)]
        extent = np.array([[x * HALF_HOLDER[0], y * HALF_HOLDER[1], z] for x, y, z in corners])
        return TaskScene(
            start=table_pose(0.175 + start.x, -0.045 + start.y, -0.2 + start.yaw_rad, HALF_BLOCK[2] + 0.001),
            goal=goal,
            approach=np.array([0.0, 0.0, 0.06]),
            height=0.06,
            grip=Grip(held_at, HALF_BLOCK[0]),
            carrying=Rigid(OBJECT),
            extent=extent - np.array([0.0, NEAR + STOP + GAP + HALF_BLOCK[1], FLOOR + HALF_BLOCK[2]]),
            roles=(RolePart(OBJECT, SceneRole.OBJECT), RolePart(TARGET, SceneRole.TARGET)),
        )


def _add_holder(spec: mujoco.MjSpec, holder: Pose, sheet: Picture, looks: np.random.Generator) -> None:
    """Floor, two cheeks and the stop, each a part of the sheet on top."""
    half_x, half_y = HALF_HOLDER
    cheek = (half_x - HALF_SLOT) / 2
    body = moving_body(spec, TARGET, holder)
    wall = (0.30, 0.27, 0.25)
    add_box(body, (HALF_SLOT, half_y, FLOOR / 2), pose((0, 0, FLOOR / 2)), color=wall)
    front = _strip(print_on_card(looks, (205, 200, 190), 16), (2 * half_x, TOP))
    scale = front.shape[1] / (2 * half_x)
    for name, middle, half_width, far in (
        ("left", -HALF_SLOT - cheek, cheek, half_y),
        ("stop", 0.0, HALF_SLOT, NEAR + STOP),
        ("right", HALF_SLOT + cheek, cheek, half_y),
    ):
        x = (middle - half_width, middle + half_width)
        columns = slice(round((x[0] + half_x) * scale), round((x[1] + half_x) * scale))
        faces = {
            "+z": textured(spec, f"holder_{name}", _cut(sheet, x, (NEAR, far))),
            "-y": textured(spec, f"holder_{name}_front", front[:, columns]),
        }
        half_length = (far - NEAR) / 2
        add_printed_box(
            body, (half_width, half_length, TOP / 2), faces, wall, pose((middle, NEAR + half_length, TOP / 2))
        )


def _add_block(spec: mujoco.MjSpec, sheet: Picture, looks: np.random.Generator) -> None:
    wide, long, high = HALF_BLOCK
    near = NEAR + STOP + GAP
    faces = {"+z": textured(spec, "block_top", _cut(sheet, (-wide, wide), (near, near + 2 * long)))}
    for face, width in (("-y", wide), ("+x", long), ("-x", long)):
        side = _strip(print_on_card(looks, (225, 205, 160), 24), (2 * width, 2 * high))
        faces[face] = textured(spec, f"block{face}", side)
    add_printed_box(moving_body(spec, OBJECT), HALF_BLOCK, faces, (0.62, 0.52, 0.40), np.eye(4))


def _add_distractors(spec: mujoco.MjSpec, looks: np.random.Generator) -> None:
    """A shorter block, a card and a tin, where neither path nor target comes."""
    places = (
        ("bar", (0.045, 0.014, 0.012), table_pose(0.03, -0.185, 0.25, 0.012)),
        ("card", (0.050, 0.032, 0.001), table_pose(-0.265, 0.20, -0.3, 0.001)),
    )
    for name, half, place in places:
        paper = tuple(looks.uniform(120, 200, 3))
        card = print_on_card(looks, paper, 14, 0.8)
        faces = {"+z": textured(spec, name, _strip(card, (2 * half[0], 2 * half[1])))}
        edge = tuple(np.array(paper) / 300)
        add_printed_box(moving_body(spec, f"distractor_{name}", place), half, faces, edge, np.eye(4))
    tin = moving_body(spec, "distractor_tin", table_pose(-0.23, -0.13, 0.0))
    color = tuple(looks.uniform(0.2, 0.7, 3))
    add_cylinder(tin, (0, 0, 0), (0, 0, 0.030), 0.020, color=color)


def _cut(sheet: Picture, x: tuple[float, float], y: tuple[float, float]) -> Part:
    """The part of the sheet over a rectangle of the holder's frame, bordered, since edges are to be clear lines."""
    scale = len(sheet) / SHEET
    left, right = (round((value + SHEET / 2) * scale) for value in x)
    bottom, top = (round((value - NEAR) * scale) for value in y)
    part = sheet[len(sheet) - top : len(sheet) - bottom, left:right].copy()
    cv2.rectangle(part, (0, 0), (right - left - 1, top - bottom - 1), (40.0, 40.0, 50.0), 7)
    return part


def _strip(card: Picture, size: tuple[float, float]) -> Part:
    """A part of a card, without its border, in the proportions of a surface."""
    inner = card[16:-16, 16:-16]
    share = size[1] / size[0]
    return inner[: round(len(inner) * min(1.0, share)), : round(len(inner) * min(1.0, 1 / share))]
