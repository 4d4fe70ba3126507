"""Contact and gravity: what is held is stopped by what it touches, and what is let go falls until it rests.

MuJoCo's own contact and dynamics. A soft weld holds the object to where the actor wants it. Where the object presses on
something, the actor gives way along that force alone, as a robot does that is compliant: what touches a wall is not
kept from sliding along it.
"""

from dataclasses import dataclass
from typing import Final, final

import mujoco
import numpy as np
from jaxtyping import Float64

from geoskill.errors import InputError
from geoskill.geometry.poses import Pose, pose, quaternion, rotation_about, rotation_vector
from geoskill.simulation.actors.actor import BODY as ACTOR
from geoskill.simulation.environment import OCCLUDER
from geoskill.simulation.motion import minimum_jerk
from geoskill.simulation.shapes import HALF_PLATE_THICKNESS, add_mocap_body, set_body_pose
from geoskill.simulation.tasks.task import ObjectDynamics, RigidObject, TaskScene

HOLD: Final = "hold"
"""Name of the body to which the object is welded, and of the weld."""
STEP_S: Final = 0.001
GUARD_N: Final = 5.0
"""Force on the object from which on the actor gives way."""
DAMPING_N_S_PER_M: Final = 50.0
"""Force beyond that one over the speed with which it gives way."""
FASTEST_M_PER_S: Final = 0.4
"""Largest speed with which it gives way."""
FELT_S: Final = 0.002
"""Time over which a force is felt: contacts are stiff, and a single step of the simulation says little."""
TOUCH_N: Final = 0.05
"""Smallest force that counts as a touch."""
# Contacts give way nine times less than the weld, which follows the actor by about 1 mm at 0.1 m/s.
CONTACT_TIME_S, HOLD_TIME_S = 0.002, 0.006
FRICTION = (0.6, 0.005, 0.0001)


def add_contact(spec: mujoco.MjSpec, task: str, scene: TaskScene) -> "SolidObject":
    """Let the object of a task's scene fall, and touch everything but the actor and the occluder.

    Raises:
        InputError: when nothing in the scene stops the object.
    """
    if not isinstance(scene.dynamics, RigidObject) or not scene.solid:
        raise InputError(
            f"contact of the task {task}: its object is flexible, or ends inside of what is drawn solid; expected a"
            " task whose object rests on something, such as sorting or insertion"
        )
    name = scene.dynamics.body
    spec.option.timestep = STEP_S
    # Stiffer friction, without which things creep down a slope.
    spec.option.cone, spec.option.impratio = mujoco.mjtCone.mjCONE_ELLIPTIC, 20
    body = spec.body(name)
    body.mocap = False
    body.add_freejoint(name=name)
    for other in spec.worldbody.bodies:
        for geom in () if other.name in (ACTOR, OCCLUDER) else other.geoms:
            # Prints are thin plates, and meshes, whose size is 0 here, have no thickness.
            if min((size for size in geom.size if size > 0), default=0.0) > HALF_PLATE_THICKNESS:
                geom.contype, geom.conaffinity = (1, 0) if other.name == name else (0, 1)
                geom.solref[:2], geom.friction, geom.condim = [CONTACT_TIME_S, 1], FRICTION, 4
    add_mocap_body(spec, HOLD, scene.start)
    weld = spec.add_equality(name=HOLD, type=mujoco.mjtEq.mjEQ_WELD, objtype=mujoco.mjtObj.mjOBJ_BODY)
    weld.name1, weld.name2, weld.solref = HOLD, name, [HOLD_TIME_S, 1]
    weld.data[:11] = [0, 0, 0, 0, 0, 0, 1, 0, 0, 0, 1]  # the object's frame is the hold's
    return SolidObject(name)


@final
@dataclass(frozen=True)
class SolidObject(ObjectDynamics):
    """A rigid body that is held, touches, and falls.

    Attributes:
        body: name of the body.
    """

    body: str

    def start(self, model: mujoco.MjModel, data: mujoco.MjData, object_pose: Pose) -> None:
        """See :meth:`ObjectDynamics.start`."""
        first = model.joint(self.body).qposadr[0]
        data.qpos[first : first + 3], data.qpos[first + 3 : first + 7] = (
            object_pose[:3, 3],
            quaternion(object_pose[:3, :3]),
        )
        data.qvel[:] = 0
        data.eq_active[model.equality(HOLD).id] = 1
        set_body_pose(model, data, HOLD, object_pose)
        mujoco.mj_forward(model, data)

    def move(self, model: mujoco.MjModel, data: mujoco.MjData, object_pose: Pose, held: bool, seconds: float) -> None:
        """See :meth:`ObjectDynamics.move`; the object may not get there, and falls if it is not held."""
        weld = model.equality(HOLD).id
        hold = body_pose(model, data, HOLD if data.eq_active[weld] else self.body)
        data.eq_active[weld] = held
        path = _path(hold, object_pose, max(1, round(seconds / STEP_S)))
        fingers = np.delete(np.arange(model.nq), np.arange(7) + model.joint(self.body).qposadr[0])
        opening = data.qpos[fingers].copy()
        give, felt = np.zeros(3), np.zeros(3)
        for target in path:
            target[:3, 3] += give
            set_body_pose(model, data, HOLD, target)
            mujoco.mj_step(model, data)
            data.qpos[fingers] = opening  # which is prescribed and not simulated
            felt += STEP_S / FELT_S * (contact_force(model, data) - felt)
            size = float(np.linalg.norm(felt))
            if held and size > GUARD_N:
                give += felt / size * min((size - GUARD_N) / DAMPING_N_S_PER_M, FASTEST_M_PER_S) * STEP_S
        if give.any():
            relaxed = target.copy()  # turned as is wanted, and where the object is: it does not press on
            relaxed[:3, 3] = body_pose(model, data, self.body)[:3, 3]
            set_body_pose(model, data, HOLD, relaxed)
        mujoco.mj_forward(model, data)


def contact_forces(model: mujoco.MjModel, data: mujoco.MjData) -> dict[str, float]:
    """Return the normal force on the object from each body that it touches, newtons."""
    forces: dict[str, float] = {}
    force = np.zeros(6)
    for number in range(data.ncon):
        mujoco.mj_contactForce(model, data, number, force)
        bodies = model.geom_bodyid[data.contact[number].geom]
        (touched,) = (body for body in bodies if model.body_dofnum[body] == 0)
        name = model.body(touched).name
        forces[name] = forces.get(name, 0.0) + float(force[0])
    return {name: total for name, total in forces.items() if total > TOUCH_N}


def contact_force(model: mujoco.MjModel, data: mujoco.MjData) -> Float64[np.ndarray, "3"]:
    """Return the sum of the normal forces on the object, in the world, newtons."""
    total, force = np.zeros(3), np.zeros(6)
    for number in range(data.ncon):
        mujoco.mj_contactForce(model, data, number, force)
        contact = data.contact[number]
        # The normal points from the first geom to the second; what is touched has no mass and is the other one.
        sign = 1.0 if model.geom_contype[contact.geom[1]] else -1.0
        total += sign * force[0] * contact.frame[:3]
    return total


def body_pose(model: mujoco.MjModel, data: mujoco.MjData, body: str) -> Pose:
    """Return the pose of a body in the world."""
    own = data.body(body)
    return pose(own.xpos, own.xmat.reshape(3, 3))


def _path(start: Pose, end: Pose, steps: int) -> Float64[np.ndarray, "steps 4 4"]:
    """Return poses along a straight line that begins and ends at rest, lest the object lags behind in the end."""
    turn = rotation_vector(end[:3, :3] @ start[:3, :3].T)
    path = np.repeat(np.eye(4)[None], steps, axis=0)
    for own, share in zip(path, minimum_jerk(np.arange(1, steps + 1) / steps), strict=True):
        own[:3, 3] = start[:3, 3] + share * (end[:3, 3] - start[:3, 3])
        own[:3, :3] = rotation_about(share * turn) @ start[:3, :3]
    return path
