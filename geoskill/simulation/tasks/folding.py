"""Folding: one end of a printed cloth is folded over onto a mark on its other half."""

import math
from typing import ClassVar, final

import cv2
import mujoco
import numpy as np

from geoskill.geometry.poses import pose, rotation_about, table_pose
from geoskill.simulation.actors.actor import Grip
from geoskill.simulation.roles import SceneRole
from geoskill.simulation.shapes import add_material
from geoskill.simulation.tasks.cloth import RADIUS, Sheet
from geoskill.simulation.tasks.task import INFINITE, PlanarPose, RolePart, Task, TaskScene
from geoskill.simulation.textures import Texture, print_on_card, printed_cloth

NAME = "cloth"
HALF = (0.15, 0.10)
# The end points to the back right, so that the camera sees one face of it while it is lifted, and then the other.
YAW_RAD = math.radians(55)
# The x at which the end's edge comes to lie, and the x of the fold that results.
LANDING = -0.085
CREASE = (HALF[0] + LANDING) / 2
# Lowest and highest x of the mark, and half of its width. The part that comes to lie on it bears its mirror image.
MARK, HALF_MARK = (-0.115, 0.005), 0.08
END = 2 * CREASE - MARK[1]
PIXELS_PER_METER = 2560
MARK_CONTRAST = 0.78
# The hand rolls about its arm, and the cloth turns further between the fingers, until it is almost upside down.
# It turns early, so that its other face is soon visible.
ROLLS = (math.radians(35), math.radians(12), math.radians(-25))
SLOPES = (math.radians(25), math.radians(125), math.radians(178))


@final
class Folding(Task):
    """A task with a cloth that has a mark on one half and its mirror image on the other; the fold joins the two."""

    name: ClassVar[str] = "folding"

    def build(
        self,
        spec: mujoco.MjSpec,
        target: PlanarPose,
        start: PlanarPose,
        appearance_rng: np.random.Generator,
        episode_rng: np.random.Generator,
    ) -> TaskScene:
        """See :meth:`Task.build`."""
        # Target and object are parts of one cloth, so the target's displacement also moves the start.
        cloth = table_pose(0.03 + target.x, target.y, YAW_RAD + target.yaw_rad, 0.0005 + RADIUS)
        grip_y = episode_rng.uniform(0.03, 0.05)
        # The hem is stiff, so most of the edge's length follows the fingers.
        sheet = Sheet(NAME, cloth, HALF, MARK[1], CREASE, (grip_y - 0.09, grip_y + 0.07), ROLLS, SLOPES)
        sheet.add(spec, add_material(spec, NAME, _print(appearance_rng), shine=0.02))
        first, last = (rotation_about(np.array([0.0, roll, 0.0])) for roll in (ROLLS[0], ROLLS[-1]))
        grip_pose = pose((0.0, grip_y, 0.004), rotation_about(np.array([0.0, 0.0, episode_rng.uniform(-0.4, -0.15)])))
        landing = np.array([LANDING, 0.0, 0.004])
        corners = np.array([[x, y, 0.0] for x in MARK for y in (-HALF_MARK, HALF_MARK)])
        return TaskScene(
            start=cloth @ pose((HALF[0] - 0.002, 0.0, 0.018), first),
            goal=cloth @ pose(landing, last),
            approach=cloth[:3, :3] @ np.array([0.015, 0.0, 0.04]),
            height=0.05,
            grip=Grip(grip_pose, 0.002),
            dynamics=sheet,
            extent=(corners - landing) @ last,
            roles=(
                RolePart(NAME, SceneRole.OBJECT, lower=(END, -INFINITE, -INFINITE)),
                RolePart(NAME, SceneRole.TARGET, (MARK[0], -HALF_MARK, -INFINITE), (MARK[1], HALF_MARK, INFINITE)),
            ),
            cloth=NAME,
        )


def _print(appearance_rng: np.random.Generator) -> Texture:
    """Return the print of the whole cloth, with the mark and as much of its mirror image about the crease as fits."""
    width, height = (round(2 * half * PIXELS_PER_METER) for half in HALF)
    cloth = cv2.resize(printed_cloth(appearance_rng, tuple(appearance_rng.uniform(150, 205, 3))), (width, height))
    left, right, top, bottom = (
        round(meters * PIXELS_PER_METER)
        for meters in (MARK[0] + HALF[0], MARK[1] + HALF[0], HALF[1] - HALF_MARK, HALF[1] + HALF_MARK)
    )
    size = (right - left, bottom - top)
    paper = appearance_rng.uniform(165, 215, 3)
    mark = cv2.resize(print_on_card(appearance_rng, tuple(paper), 34), size, interpolation=cv2.INTER_AREA)
    # The mark is paler than the end, whose print has to be recognized at a slant and in shade while it is carried.
    cloth[top:bottom, left:right] = (MARK_CONTRAST * mark + (1 - MARK_CONTRAST) * paper).astype(np.uint8)
    begin = round((END + HALF[0]) * PIXELS_PER_METER)
    cloth[top:bottom, begin:] = mark[:, ::-1][:, : width - begin]
    return np.asarray(cloth)
