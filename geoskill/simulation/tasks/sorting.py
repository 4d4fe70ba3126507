"""Sorting: a printed box goes onto the matching tile of a tray.

Box and tile match in the color of their paper, not in their prints: if the prints were equal, no method that considers
single features could tell those of the box from those of the tile.
"""

from typing import ClassVar, final

import mujoco
import numpy as np

from geoskill.geometry.poses import Pose, pose, rotation_about, table_pose
from geoskill.simulation.actors.actor import Grip
from geoskill.simulation.roles import SceneRole
from geoskill.simulation.shapes import add_box, add_material, add_mocap_body, add_printed_box
from geoskill.simulation.tasks.task import PlanarPose, RigidObject, RolePart, Task, TaskScene
from geoskill.simulation.textures import print_on_card, wood

# The tile is larger than the box, so that it is still visible when the box is on it.
HALF_BOX = (0.027, 0.027, 0.018)
HALF_TILE = 0.047
PITCH = 0.102
COLUMNS, ROWS = 3, 2
FLOOR = 0.006
OBJECT, TARGET = "box", "tile"


@final
class Sorting(Task):
    """A task with a tray of six printed tiles, of which one matches the box and the others are distractors."""

    name: ClassVar[str] = "sorting"

    def build(
        self,
        spec: mujoco.MjSpec,
        target: PlanarPose,
        start: PlanarPose,
        appearance_rng: np.random.Generator,
        episode_rng: np.random.Generator,
    ) -> TaskScene:
        """See :meth:`Task.build`."""
        matching = int(appearance_rng.integers(COLUMNS * ROWS))
        tray = table_pose(-0.085 + target.x, 0.035 + target.y, target.yaw_rad)
        _add_tray(spec, tray, appearance_rng)
        _add_tiles_and_box(spec, tray, matching, appearance_rng)
        grip_pose = pose(
            (0.0, episode_rng.uniform(0.002, 0.012), episode_rng.uniform(-0.004, 0.004)),
            rotation_about(np.array([0.0, 0.0, episode_rng.uniform(-0.3, 0.2)])),
        )
        goal = tray @ _compartment(matching) @ pose((0.0, 0.0, 0.002 + HALF_BOX[2]))
        return TaskScene(
            start=table_pose(0.195 + start.x, -0.075 + start.y, start.yaw_rad, HALF_BOX[2] + 0.001),
            goal=goal,
            approach=np.array([0.0, 0.0, 0.05]),
            height=0.08,
            grip=Grip(grip_pose, HALF_BOX[0]),
            dynamics=RigidObject(OBJECT),
            extent=np.array([[x, y, -HALF_BOX[2]] for x in (-HALF_TILE, HALF_TILE) for y in (-HALF_TILE, HALF_TILE)]),
            roles=(RolePart(OBJECT, SceneRole.OBJECT), RolePart(TARGET, SceneRole.TARGET)),
        )


def _compartment(index: int) -> Pose:
    """Return the pose of a compartment's floor in the tray's frame."""
    row, column = divmod(index, COLUMNS)
    return pose(((column - (COLUMNS - 1) / 2) * PITCH, (row - (ROWS - 1) / 2) * PITCH, FLOOR))


def _add_tray(spec: mujoco.MjSpec, tray: Pose, appearance_rng: np.random.Generator) -> None:
    """Add the tray: a floor and the walls of its compartments."""
    board = add_material(spec, "tray", wood(appearance_rng, (120, 98, 76), 5.0))
    body = add_mocap_body(spec, "tray", tray)
    half_x, half_y, wall = COLUMNS * PITCH / 2, ROWS * PITCH / 2, 0.004
    add_box(body, (half_x, half_y, FLOOR / 2), pose((0, 0, FLOOR / 2)), board)
    for column in range(COLUMNS + 1):
        x = (column - COLUMNS / 2) * PITCH
        add_box(body, (wall, half_y + wall, 0.008), pose((x, 0, 0.008)), board)
    for row in range(ROWS + 1):
        y = (row - ROWS / 2) * PITCH
        add_box(body, (half_x + wall, wall, 0.008), pose((0, y, 0.008)), board)


def _add_tiles_and_box(spec: mujoco.MjSpec, tray: Pose, matching: int, appearance_rng: np.random.Generator) -> None:
    """Add a tile per compartment, and the box on the paper of the matching one."""
    for index in range(COLUMNS * ROWS):
        is_match = index == matching
        # The distractors have fewer and paler shapes, so that object and target are the most prominent things.
        paper = tuple(appearance_rng.uniform(200, 245, 3)) if is_match else tuple(appearance_rng.uniform(130, 215, 3))
        card = print_on_card(appearance_rng, paper, 34 if is_match else 14, 1.0 if is_match else 0.75)
        name = TARGET if is_match else f"distractor_{index}"
        material = add_material(spec, name, card)
        tile = add_mocap_body(spec, name, tray @ _compartment(index))
        add_box(tile, (HALF_TILE, HALF_TILE, 0.001), pose((0, 0, 0.001)), material)
        if is_match:
            box_print = add_material(spec, "print", print_on_card(appearance_rng, paper, 34))
    sides = {
        face: add_material(spec, f"side{face}", print_on_card(appearance_rng, (225, 215, 190), 12))
        for face in ("-y", "+x", "-x")
    }
    box = add_mocap_body(spec, OBJECT)
    add_printed_box(box, HALF_BOX, {"+z": box_print, **sides}, (0.72, 0.58, 0.42), np.eye(4))
