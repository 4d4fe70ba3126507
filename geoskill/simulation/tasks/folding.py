"""One end of a printed cloth is folded over onto a mark on its other half."""

import math
from typing import final

import cv2
import mujoco
import numpy as np

from geoskill.geometry.poses import pose, rotation_about, table_pose
from geoskill.simulation.actors.actor import Grip
from geoskill.simulation.parts import textured
from geoskill.simulation.roles import SceneRole
from geoskill.simulation.tasks.cloth import RADIUS, Sheet
from geoskill.simulation.tasks.task import INFINITE, RolePart, TablePlace, Task, TaskScene
from geoskill.simulation.textures import Texture, print_on_card, printed_cloth

NAME = "cloth"
HALF = (0.15, 0.10)
# Towards the back right, so that the camera sees the one face of the end while it is lifted, and then the other.
YAW_RAD = math.radians(55)
# Where the end's edge comes to lie, and so where the cloth is folded.
LANDING = -0.085
CREASE = (HALF[0] + LANDING) / 2
# The mark from -x to +x, and half of its width; what comes to lie on it bears its mirror image.
MARK, HALF_MARK = (-0.115, 0.005), 0.08
END = 2 * CREASE - MARK[1]
PIXELS_PER_METRE = 2560
PALE = 0.78
# The hand rolls about its arm, and the cloth turns on between the fingers, almost upside down in all. It turns early,
# so that its other face is soon seen.
ROLLS = (math.radians(35), math.radians(12), math.radians(-25))
SLOPES = (math.radians(25), math.radians(125), math.radians(178))


@final
class Folding(Task):
    """A cloth with a mark on one half and its mirror image on the other, of which the fold brings both together."""

    @property
    def name(self) -> str:
        """See :attr:`Task.name`."""
        return "folding"

    def build(
        self,
        spec: mujoco.MjSpec,
        target: TablePlace,
        start: TablePlace,
        looks: np.random.Generator,
        take: np.random.Generator,
    ) -> TaskScene:
        """See :meth:`Task.build`."""
        # Both ends are of one cloth: where its mark is decides where the other end starts.
        cloth = table_pose(0.03 + target.x, target.y, YAW_RAD + target.yaw_rad, 0.0005 + RADIUS)
        grip_y = take.uniform(0.03, 0.05)
        # The hem is stiff, and so goes along for most of its length.
        sheet = Sheet(NAME, cloth, HALF, MARK[1], CREASE, (grip_y - 0.09, grip_y + 0.07), ROLLS, SLOPES)
        sheet.add(spec, textured(spec, NAME, _print(looks), shine=0.02))
        first, last = (rotation_about(np.array([0.0, roll, 0.0])) for roll in (ROLLS[0], ROLLS[-1]))
        grip = pose((0.0, grip_y, 0.004), rotation_about(np.array([0.0, 0.0, take.uniform(-0.4, -0.15)])))
        landing = np.array([LANDING, 0.0, 0.004])
        corners = np.array([[x, y, 0.0] for x in MARK for y in (-HALF_MARK, HALF_MARK)])
        return TaskScene(
            start=cloth @ pose((HALF[0] - 0.002, 0.0, 0.018), first),
            goal=cloth @ pose(landing, last),
            approach=cloth[:3, :3] @ np.array([0.015, 0.0, 0.04]),
            height=0.05,
            grip=Grip(grip, 0.002),
            carrying=sheet,
            extent=(corners - landing) @ last,
            roles=(
                RolePart(NAME, SceneRole.OBJECT, lower=(END, -INFINITE, -INFINITE)),
                RolePart(NAME, SceneRole.TARGET, (MARK[0], -HALF_MARK, -INFINITE), (MARK[1], HALF_MARK, INFINITE)),
            ),
            cloth=NAME,
        )


def _print(looks: np.random.Generator) -> Texture:
    """The whole cloth, its mark, and the mark's mirror image about the crease as far as there is cloth."""
    width, height = (round(2 * half * PIXELS_PER_METRE) for half in HALF)
    cloth = cv2.resize(printed_cloth(looks, tuple(looks.uniform(150, 205, 3))), (width, height))
    left, right, top, bottom = (
        round(meters * PIXELS_PER_METRE)
        for meters in (MARK[0] + HALF[0], MARK[1] + HALF[0], HALF[1] - HALF_MARK, HALF[1] + HALF_MARK)
    )
    size = (right - left, bottom - top)
    paper = looks.uniform(165, 215, 3)
    mark = cv2.resize(print_on_card(looks, tuple(paper), 34), size, interpolation=cv2.INTER_AREA)
    # Paler than the end, which is seen at a slant and in shade while it is carried: both are to be recognized.
    cloth[top:bottom, left:right] = (PALE * mark + (1 - PALE) * paper).astype(np.uint8)
    begin = round((END + HALF[0]) * PIXELS_PER_METRE)
    cloth[top:bottom, begin:] = mark[:, ::-1][:, : width - begin]
    return np.asarray(cloth)
