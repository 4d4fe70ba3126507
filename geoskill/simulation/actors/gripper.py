"""A robot's parallel-jaw gripper on an arm."""

import math
from typing import final

import mujoco
import numpy as np

from geoskill.geometry.poses import pose
from geoskill.simulation.actors.actor import Actor, Grip, add_root
from geoskill.simulation.shapes import add_box, add_cylinder

OPENING_M = 0.018
# Elevation of the arm above the horizontal.
ELEVATION_RAD = math.radians(42)


@final
class Gripper(Actor):
    """A gripper with two sliding fingers, on a gray and black arm."""

    def add(self, spec: mujoco.MjSpec, grip: Grip, appearance_rng: np.random.Generator) -> None:
        """See :meth:`Actor.add`."""
        shell = (appearance_rng.uniform(0.62, 0.82),) * 3
        dark, accent = (0.09, 0.09, 0.10), tuple(appearance_rng.uniform(0.05, 0.6, 3))
        root = add_root(spec)
        # In the tool's frame the arm comes from +z; its x axis is the grip's.
        tool = root.add_body(name="tool", quat=[math.cos(_tool_roll_rad() / 2), math.sin(_tool_roll_rad() / 2), 0, 0])
        half_width = grip.half_width_m
        for name, side in (("left_finger", -1.0), ("right_finger", 1.0)):
            finger = tool.add_body(name=name)
            finger.add_joint(name=name, type=mujoco.mjtJoint.mjJNT_SLIDE, axis=[side, 0, 0])
            x = side * (half_width + 0.006)
            add_box(finger, (0.006, 0.011, 0.046), pose((x, 0.0, 0.030)), color=dark)
            add_box(finger, (0.010, 0.014, 0.014), pose((x + side * 0.004, 0.0, 0.082)), color=shell)
        half_palm = max(half_width + 0.030, 0.045)
        add_box(tool, (half_palm, 0.030, 0.022), pose((0, 0, 0.118)), color=shell)
        add_box(tool, (half_palm * 0.55, 0.0305, 0.008), pose((0, 0, 0.120)), color=accent)
        for x in (-0.8 * half_palm, 0.8 * half_palm):
            add_cylinder(tool, (x, -0.0315, 0.118), (x, 0.0315, 0.118), 0.004, color=dark)
        add_cylinder(tool, (0, 0, 0.140), (0, 0, 0.180), 0.032, color=dark)
        add_cylinder(tool, (0, 0, 0.180), (0, 0, 0.245), 0.040, color=shell)
        add_cylinder(tool, (0, 0, 0.245), (0, 0, 0.256), 0.042, color=accent)
        add_cylinder(tool, (0, 0, 0.256), (0, 0.05, 0.75), 0.044, color=shell)

    def set_opening(self, model: mujoco.MjModel, data: mujoco.MjData, opening: float) -> None:
        """See :meth:`Actor.set_opening`."""
        for name in ("left_finger", "right_finger"):
            data.qpos[model.joint(name).qposadr[0]] = opening * OPENING_M


def _tool_roll_rad() -> float:
    """Return the turn about x that makes the tool's z axis point back and up."""
    return -(math.pi / 2 - ELEVATION_RAD)
