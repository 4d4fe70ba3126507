"""A person's hand, with the forearm in a sleeve."""

from typing import final

import mujoco
import numpy as np

from geoskill.geometry.poses import pose
from geoskill.simulation.actors.actor import Actor, Grip, add_root
from geoskill.simulation.shapes import add_box, add_capsule, add_material
from geoskill.simulation.textures import felt, skin

FINGER_RADIUS = 0.0078
OPENING_RAD = 0.45
# Heights of the four fingers above the grip, from the index finger down, meters.
FINGER_HEIGHTS = (0.030, 0.014, -0.001, -0.013)
FINGERS = ("index", "middle", "ring", "little")


@final
class Hand(Actor):
    """A hand with four fingers on the grip's +x side, the thumb on the -x side, the palm and the forearm behind."""

    def add(self, spec: mujoco.MjSpec, grip: Grip, appearance_rng: np.random.Generator) -> None:
        """See :meth:`Actor.add`."""
        tone = appearance_rng.uniform(0.75, 1.05)
        color = (215 * tone, 165 * tone, 138 * tone)
        flesh = add_material(spec, "skin", skin(appearance_rng, color), (40, 40), per_meter=True, shine=0.2)
        fabric = felt(appearance_rng, tuple(appearance_rng.uniform(40, 130, 3)))
        sleeve = add_material(spec, "sleeve", fabric, (12, 12), per_meter=True)
        root = add_root(spec)
        half_width = grip.half_width_m
        palm_y, wrist = 0.066, (0.004, 0.125, 0.022)
        half_palm = max(half_width, 0.018)
        for name, height in zip(FINGERS, FINGER_HEIGHTS, strict=True):
            length = 0.9 if name == "little" else 1.0
            knuckle = (half_palm + 0.010, palm_y, height + 0.002)
            finger = root.add_body(name=name, pos=knuckle)
            finger.add_joint(name=name, type=mujoco.mjtJoint.mjJNT_HINGE, axis=[0, 0, 1])
            bend = (half_width - half_palm + 0.006, -0.034 * length, 0.003)
            tip = (half_width - half_palm + FINGER_RADIUS - 0.010, -0.068 * length, -0.001)
            add_capsule(finger, (0, 0, 0), bend, FINGER_RADIUS * 1.1, flesh)
            add_capsule(finger, bend, tip, FINGER_RADIUS, flesh)
        thumb = root.add_body(name="thumb", pos=(-half_palm - 0.006, palm_y + 0.004, 0.016))
        thumb.add_joint(name="thumb", type=mujoco.mjtJoint.mjJNT_HINGE, axis=[0, 0, 1])
        bend = (-(half_width - half_palm) - 0.010, -0.036, 0.000)
        add_capsule(thumb, (0, 0, 0), bend, 0.0105, flesh)
        add_capsule(thumb, bend, (-(half_width - half_palm) - 0.003, -0.064, -0.008), 0.0092, flesh)
        add_box(root, (half_palm, 0.008, 0.020), pose((0.0, palm_y + 0.010, 0.010)), flesh)
        for x, height in ((half_palm, 0.030), (half_palm, -0.010), (-half_palm, 0.020), (0.0, 0.026), (0.0, -0.002)):
            add_capsule(root, (x, palm_y + 0.004, height), wrist, 0.016, flesh)
        elbow = (0.05, 0.42, 0.21)
        sleeve_end = tuple(0.75 * a + 0.25 * b for a, b in zip(wrist, elbow, strict=True))
        add_capsule(root, wrist, sleeve_end, 0.025, flesh)
        add_capsule(root, sleeve_end, elbow, 0.038, sleeve)
        add_capsule(root, elbow, (0.10, 0.70, 0.30), 0.046, sleeve)

    def set_opening(self, model: mujoco.MjModel, data: mujoco.MjData, opening: float) -> None:
        """See :meth:`Actor.set_opening`."""
        for name in FINGERS:
            data.qpos[model.joint(name).qposadr[0]] = opening * OPENING_RAD
        data.qpos[model.joint("thumb").qposadr[0]] = -opening * OPENING_RAD
