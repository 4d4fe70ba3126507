"""Covering: a printed box is set down on a printed mat."""

from typing import ClassVar, final

import mujoco
import numpy as np

from geoskill.geometry.poses import pose, table_pose
from geoskill.simulation.actors.actor import Grip
from geoskill.simulation.roles import SceneRole
from geoskill.simulation.shapes import add_box, add_material, add_mocap_body, add_printed_box
from geoskill.simulation.tasks.task import PlanarPose, RigidObject, RolePart, Task, TaskScene
from geoskill.simulation.textures import print_on_card

HALF_BOX = (0.03, 0.03, 0.02)
HALF_MAT = 0.06


@final
class Covering(Task):
    """A task with one box and one mat, and nothing that looks like either."""

    name: ClassVar[str] = "covering"

    def build(
        self,
        spec: mujoco.MjSpec,
        target: PlanarPose,
        start: PlanarPose,
        appearance_rng: np.random.Generator,
        episode_rng: np.random.Generator,
    ) -> TaskScene:
        """See :meth:`Task.build`."""
        mat_pose = table_pose(-0.1 + target.x, 0.03 + target.y, target.yaw_rad)
        mat_print = add_material(spec, "mat", print_on_card(appearance_rng, (220, 200, 160)))
        box_print = add_material(spec, "print", print_on_card(appearance_rng, (170, 210, 225)))
        add_box(add_mocap_body(spec, "mat", mat_pose), (HALF_MAT, HALF_MAT, 0.001), pose((0, 0, 0.001)), mat_print)
        add_printed_box(add_mocap_body(spec, "box"), HALF_BOX, {"+z": box_print}, (0.7, 0.6, 0.4), np.eye(4))
        grip = pose((0.0, episode_rng.uniform(0.002, 0.012), 0.0))
        corners = [[x, y, -HALF_BOX[2]] for x in (-HALF_MAT, HALF_MAT) for y in (-HALF_MAT, HALF_MAT)]
        return TaskScene(
            start=table_pose(0.19 + start.x, -0.07 + start.y, start.yaw_rad, HALF_BOX[2] + 0.001),
            goal=mat_pose @ pose((0.0, 0.0, 0.002 + HALF_BOX[2])),
            approach=np.array([0.0, 0.0, 0.05]),
            height=0.08,
            grip=Grip(grip, HALF_BOX[0]),
            dynamics=RigidObject("box"),
            extent=np.array(corners),
            roles=(RolePart("box", SceneRole.OBJECT), RolePart("mat", SceneRole.TARGET)),
        )
