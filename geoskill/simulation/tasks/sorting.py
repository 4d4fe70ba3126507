"""A printed box goes onto the tile of a tray that matches it.

They match in the color of their paper. Were the prints the same, nothing that looks at single features could tell
those of the box from those of the tile.
"""

from typing import final

import mujoco
import numpy as np

from geoskill.geometry.poses import pose, rotation_about, table_pose
from geoskill.simulation.actors.actor import Grip
from geoskill.simulation.parts import add_box, add_printed_box, moving_body, textured
from geoskill.simulation.roles import SceneRole
from geoskill.simulation.tasks.task import Rigid, RolePart, TablePlace, Task, TaskScene
from geoskill.simulation.textures import print_on_card, wood

# The tile is larger than the box, so that what the box is brought to can still be seen when it is there.
HALF_BOX = (0.027, 0.027, 0.018)
HALF_TILE = 0.047
PITCH = 0.102
COLUMNS, ROWS = 3, 2
FLOOR = 0.006
OBJECT, TARGET = "box", "tile"


@final
class Sorting(Task):
    """A tray of six compartments, each with a printed tile; one tile matches the box, the others are distractors."""

    @property
    def name(self) -> str:
        """See :attr:`Task.name`."""
        return "sorting"

    def build(
        self,
        spec: mujoco.MjSpec,
        target: TablePlace,
        start: TablePlace,
        looks: np.random.Generator,
        take: np.random.Generator,
    ) -> TaskScene:
        """See :meth:`Task.build`."""
        matching = int(looks.integers(COLUMNS * ROWS))
        tray = table_pose(-0.085 + target.x, 0.035 + target.y, target.yaw_rad)
        board = textured(spec, "tray", wood(looks, (120, 98, 76), 5.0))
        body = moving_body(spec, "tray", tray)
        half_x, half_y, wall = COLUMNS * PITCH / 2, ROWS * PITCH / 2, 0.004
        add_box(body, (half_x, half_y, FLOOR / 2), pose((0, 0, FLOOR / 2)), board)
        for column in range(COLUMNS + 1):
            x = (column - COLUMNS / 2) * PITCH
            add_box(body, (wall, half_y + wall, 0.008), pose((x, 0, 0.008)), board)
        for row in range(ROWS + 1):
            y = (row - ROWS / 2) * PITCH
            add_box(body, (half_x + wall, wall, 0.008), pose((0, y, 0.008)), board)

        places = []
        for number in range(COLUMNS * ROWS):
            row, column = divmod(number, COLUMNS)
            places.append(pose(((column - (COLUMNS - 1) / 2) * PITCH, (row - (ROWS - 1) / 2) * PITCH, FLOOR)))
            match = number == matching
            # The distractors are printed as well, but not as richly: object and target are the best seen things.
            paper = tuple(looks.uniform(200, 245, 3)) if match else tuple(looks.uniform(130, 215, 3))
            card = print_on_card(looks, paper, 34 if match else 14, 1.0 if match else 0.75)
            name = TARGET if match else f"distractor_{number}"
            material = textured(spec, name, card)
            tile = moving_body(spec, name, tray @ places[number])
            add_box(tile, (HALF_TILE, HALF_TILE, 0.001), pose((0, 0, 0.001)), material)
            if match:
                print_of_box = textured(spec, "print", print_on_card(looks, paper, 34))

        sides = {
            face: textured(spec, f"side{face}", print_on_card(looks, (225, 215, 190), 12))
            for face in ("-y", "+x", "-x")
        }
        box = moving_body(spec, OBJECT)
        add_printed_box(box, HALF_BOX, {"+z": print_of_box, **sides}, (0.72, 0.58, 0.42), np.eye(4))
        held_at = pose(
            (0.0, take.uniform(0.002, 0.012), take.uniform(-0.004, 0.004)),
            rotation_about(np.array([0.0, 0.0, take.uniform(-0.3, 0.2)])),
        )
        goal = tray @ places[matching] @ pose((0.0, 0.0, 0.002 + HALF_BOX[2]))
        return TaskScene(
            start=table_pose(0.195 + start.x, -0.075 + start.y, start.yaw_rad, HALF_BOX[2] + 0.001),
            goal=goal,
            approach=np.array([0.0, 0.0, 0.05]),
            height=0.08,
            grip=Grip(held_at, HALF_BOX[0]),
            carrying=Rigid(OBJECT),
            extent=np.array([[x, y, -HALF_BOX[2]] for x in (-HALF_TILE, HALF_TILE) for y in (-HALF_TILE, HALF_TILE)]),
            roles=(RolePart(OBJECT, SceneRole.OBJECT), RolePart(TARGET, SceneRole.TARGET)),
        )
