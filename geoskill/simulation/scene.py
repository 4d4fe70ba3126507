"""From a task and conditions to a recording."""

from dataclasses import dataclass
from typing import final

import mujoco
import numpy as np
from jaxtyping import Float64

from geoskill.errors import InputError
from geoskill.geometry.camera import PinholeCamera, back_project, project
from geoskill.geometry.poses import Pose, inverse, pose, transform
from geoskill.simulation import renderer
from geoskill.simulation.actors.actor import BODY as ACTOR
from geoskill.simulation.actors.actor import Actor
from geoskill.simulation.actors.gripper import Gripper
from geoskill.simulation.actors.hand import Hand
from geoskill.simulation.conditions import START_SPREAD, Conditions, camera_course, looking_aside
from geoskill.simulation.environment import (
    PASSER_BY,
    Passing,
    add_light,
    add_passer_by,
    add_table,
    lamp_course,
    passing_course,
)
from geoskill.simulation.motion import Displacement, Way, human_motion, robot_motion
from geoskill.simulation.parts import place
from geoskill.simulation.randomness import generator
from geoskill.simulation.recording import DEPTH_UNIT_M, FRAME_RATE, Cloth, Recording, as_png
from geoskill.simulation.roles import SceneRole
from geoskill.simulation.sensor import compress, expose, exposure_course
from geoskill.simulation.tasks.task import RolePart, TablePlace, Task, TaskScene

WIDTH, HEIGHT = 640, 480


@final
@dataclass(frozen=True)
class RecordingSettings:
    """What a recording is made from; the same settings give the same recording.

    Attributes:
        task: what is done.
        conditions: who does it, and under what conditions.
        seed: of everything by which the things are recognized: prints and colors.
        take: name of the recording; draws everything else, such as places, path and speed.
        stride: only every so many frames are rendered, and the last one; all of them move the things.

    Raises:
        InputError: when ``seed`` is negative.
        ValueError: when ``stride`` is not positive.
    """

    task: Task
    conditions: Conditions
    seed: int
    take: str
    stride: int = 1

    def __post_init__(self) -> None:
        if self.seed < 0:
            raise InputError(f"seed={self.seed}: expected 0 or more for a simulated task")
        if self.stride < 1:
            raise ValueError(f"stride={self.stride}: expected at least 1")


def record(settings: RecordingSettings) -> Recording:
    """Render a recording.

    Raises:
        InputError: where there is no OpenGL context.
    """
    conditions = settings.conditions
    hard = conditions.severity > 0
    take = generator(settings.seed, settings.task.name, "take", settings.take)
    frames = int(take.integers(80, 111))
    spec = mujoco.MjSpec()
    renderer.add_camera(spec, WIDTH, HEIGHT)
    dark = 0.0 if not conditions.illumination else conditions.severity
    room = settings.take if conditions.random_target else "usual"
    add_table(spec, generator(settings.seed, "table", room))
    add_light(spec, min(1.0, dark), generator(settings.seed, "light", settings.take))
    scene = settings.task.build(
        spec,
        conditions.target_spread().around(TablePlace(0, 0, 0), take),
        START_SPREAD.around(TablePlace(0, 0, 0), take),
        generator(settings.seed, settings.task.name, "looks"),
        take,
    )
    actor: Actor = Hand() if conditions.actor == "human" else Gripper()
    actor.add(spec, scene.grip, generator(settings.seed, "actor", settings.take))
    lens = renderer.lens(WIDTH, HEIGHT)
    camera = camera_course(conditions, frames, take)
    way = Way(scene.start, scene.goal, scene.approach, scene.height)
    if conditions.outside_fov and hard and scene.cloth is None:
        way = Way(scene.start, scene.goal, scene.approach, scene.height, _outside(lens, camera[0], conditions, way))
    if conditions.actor == "human":
        motion = human_motion(way, frames, conditions.confidence, take)
    else:
        motion = robot_motion(way, frames)
    courses: dict[str, Float64[np.ndarray, "frames 4 4"]] = {}
    if conditions.occlusion and hard:
        add_passer_by(spec, generator(settings.seed, "cover", settings.take))
        courses[PASSER_BY] = _passing(conditions, camera, lens, scene, take)
    if dark > 0:
        courses["lamp"] = lamp_course(frames, take)
    if conditions.outside_fov and hard and scene.cloth is not None:
        camera = looking_aside(camera, conditions.severity)  # for a cloth that lies on the table cannot be carried away
    return _play(spec, scene, actor, motion, camera, lens, courses, take, settings.stride)


def _outside(lens: PinholeCamera, camera: Pose, conditions: Conditions, way: Way) -> Float64[np.ndarray, "3"]:
    """A place to the right of the picture, from which a thing of the usual size is not seen at all."""
    view = PinholeCamera(lens.width, lens.height, lens.focal_px, camera)
    pixels, depth = project(view, way.start[None, :3, 3] + np.array([0.0, 0.0, way.height]))
    column = pixels[0, 0] + conditions.severity * (1.22 * lens.width - pixels[0, 0])
    return np.asarray(back_project(view, np.array([[column, pixels[0, 1]]]), depth)[0])


def _passing(
    conditions: Conditions,
    camera: Float64[np.ndarray, "frames 4 4"],
    lens: PinholeCamera,
    scene: TaskScene,
    take: np.random.Generator,
) -> Float64[np.ndarray, "frames 4 4"]:
    corners = transform(scene.goal, scene.extent)
    hidden = min(1.0, 0.72 * conditions.severity)
    begin = take.uniform(0.05, 0.25)
    return passing_course(camera, lens, corners, Passing(hidden, begin, begin + 0.62), -1.0)


def _play(
    spec: mujoco.MjSpec,
    scene: TaskScene,
    actor: Actor,
    motion: Displacement,
    camera: Float64[np.ndarray, "frames 4 4"],
    lens: PinholeCamera,
    courses: dict[str, Float64[np.ndarray, "frames 4 4"]],
    take: np.random.Generator,
    stride: int,
) -> Recording:
    model = spec.compile()
    data = mujoco.MjData(model)
    pictures, shown, depths, poses, vertices = [], [], [], [], []
    exposures = exposure_course(len(camera), take)
    rendered = sorted({*range(0, len(camera), stride), len(camera) - 1})
    scene.carrying.start(model, data, motion.led[0])
    with renderer.Renderer(model, lens.width, lens.height) as rendering:
        for frame, matrix in enumerate(camera):
            led = motion.led[frame]
            renderer.place_camera(model, data, matrix)
            actor.open(model, data, float(motion.opening[frame]))
            place(model, data, ACTOR, led @ scene.grip.pose @ pose((0.0, float(motion.retreat[frame]), 0.0)))
            for body, course in courses.items():
                place(model, data, body, course[frame])
            scene.carrying.lead(model, data, led, bool(motion.held[frame]), 1 / FRAME_RATE)
            if frame not in rendered:
                continue
            pictures.append(compress(expose(rendering.picture(data), exposures[frame], take)))
            shown.append(as_png((rendering.bodies(data) + 2).astype(np.uint8)))
            depth = rendering.depth_m(data) / DEPTH_UNIT_M
            depths.append(as_png(np.clip(depth + 0.5, 0, 65535).astype(np.uint16)))
            poses.append(_poses(data))
            if scene.cloth is not None:
                vertices.append(data.flexvert_xpos.copy())
    names = [model.body(number).name for number in range(model.nbody)]
    return Recording(
        pictures,
        shown,
        depths,
        names,
        np.stack(poses),
        lens,
        camera[rendered],
        (*scene.roles, *(RolePart(name, SceneRole.AGENT) for name in _parts(model, ACTOR))),
        None if scene.cloth is None else _cloth(model, scene.cloth, np.stack(vertices)),
    )


def _cloth(model: mujoco.MjModel, name: str, vertices: Float64[np.ndarray, "frames v 3"]) -> Cloth:
    """The flexible part that belongs to the body of its name, which is where it lies flat at first."""
    flat = mujoco.MjData(model)
    mujoco.mj_forward(model, flat)
    rest = transform(inverse(_poses(flat)[model.body(name).id]), flat.flexvert_xpos)
    return Cloth(name, rest, model.flex_elem.reshape(-1, 3).copy(), vertices)


def _poses(data: mujoco.MjData) -> Float64[np.ndarray, "bodies 4 4"]:
    matrices = np.repeat(np.eye(4)[None], len(data.xpos), axis=0)
    matrices[:, :3, :3] = data.xmat.reshape(-1, 3, 3)
    matrices[:, :3, 3] = data.xpos
    return matrices


def _parts(model: mujoco.MjModel, body: str) -> list[str]:
    """A body and what is fastened to it."""
    root = model.body(body).id
    return [model.body(number).name for number in range(model.nbody) if model.body(number).rootid[0] == root]
