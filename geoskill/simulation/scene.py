"""From a task and conditions to a recording."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import final

import mujoco
import numpy as np
from jaxtyping import Float64

from geoskill.config import ScenarioConfig
from geoskill.errors import InputError
from geoskill.geometry.camera import PinholeCamera, back_project, project
from geoskill.geometry.poses import Pose, inverse, pose, transform
from geoskill.simulation.actors.actor import BODY as ACTOR
from geoskill.simulation.actors.actor import Actor
from geoskill.simulation.actors.gripper import Gripper
from geoskill.simulation.actors.hand import Hand
from geoskill.simulation.conditions import START_RANGE, camera_trajectory, pan_aside, target_range
from geoskill.simulation.environment import (
    LAMP,
    OCCLUDER,
    Occlusion,
    add_light,
    add_occluder,
    add_table,
    lamp_trajectory,
    occluder_trajectory,
)
from geoskill.simulation.motion import PathSpec, ScriptedMotion, human_motion, robot_motion
from geoskill.simulation.randomness import generator
from geoskill.simulation.recording import DEPTH_UNIT_M, FRAME_RATE, Cloth, Recording, encode_png
from geoskill.simulation.renderer import Renderer, add_camera, camera_intrinsics, set_camera_pose
from geoskill.simulation.roles import SceneRole
from geoskill.simulation.sensor import compress, expose, exposure_drift
from geoskill.simulation.shapes import set_body_pose
from geoskill.simulation.tasks.task import PlanarPose, RolePart, Task, TaskScene

WIDTH, HEIGHT = 640, 480

Trajectory = Float64[np.ndarray, "frames 4 4"]


@final
@dataclass(frozen=True)
class RecordingSettings:
    """Settings of a recording; equal settings give equal recordings.

    Attributes:
        task: the task to perform.
        scenario: who performs it, and which difficulties there are.
        seed: of the appearance of things: prints and colors.
        episode: name of the recording, which seeds everything else, such as placements, path and speed.
        stride: every ``stride``-th frame and the last one are rendered; things move on all of them.

    Raises:
        InputError: when ``seed`` is negative.
        ValueError: when ``stride`` is not positive.
    """

    task: Task
    scenario: ScenarioConfig
    seed: int
    episode: str
    stride: int = 1

    def __post_init__(self) -> None:
        if self.seed < 0:
            raise InputError(f"seed={self.seed}: expected 0 or more for a simulated task")
        if self.stride < 1:
            raise ValueError(f"stride={self.stride}: expected at least 1")


def record(settings: RecordingSettings) -> Recording:
    """Render a recording.

    Raises:
        InputError: when no OpenGL context is available.
    """
    scenario = settings.scenario
    hard = scenario.severity > 0
    # The strings only seed the generators; changing one changes every recording.
    episode_rng = generator(settings.seed, settings.task.name, "take", settings.episode)
    frames = int(episode_rng.integers(80, 111))
    spec = mujoco.MjSpec()
    add_camera(spec, WIDTH, HEIGHT)
    darkness = 0.0 if not scenario.illumination else scenario.severity
    room = settings.episode if scenario.random_target else "usual"
    add_table(spec, generator(settings.seed, "table", room))
    add_light(spec, min(1.0, darkness), generator(settings.seed, "light", settings.episode))
    scene = settings.task.build(
        spec,
        target_range(scenario).sample_around(PlanarPose(0, 0, 0), episode_rng),
        START_RANGE.sample_around(PlanarPose(0, 0, 0), episode_rng),
        generator(settings.seed, settings.task.name, "looks"),
        episode_rng,
    )
    actor: Actor = Hand() if scenario.actor == "human" else Gripper()
    actor.add(spec, scene.grip, generator(settings.seed, "actor", settings.episode))
    intrinsics = camera_intrinsics(WIDTH, HEIGHT)
    camera_poses = camera_trajectory(scenario, frames, episode_rng)
    path = PathSpec(scene.start, scene.goal, scene.approach, scene.height)
    if scenario.outside_fov and hard and scene.cloth is None:
        path = replace(path, detour=_outside(intrinsics, camera_poses[0], scenario, path))
    if scenario.actor == "human":
        motion = human_motion(path, frames, scenario.confidence, episode_rng)
    else:
        motion = robot_motion(path, frames)
    trajectories: dict[str, Trajectory] = {}
    if scenario.occlusion and hard:
        add_occluder(spec, generator(settings.seed, "cover", settings.episode))
        trajectories[OCCLUDER] = _occluder(scenario, camera_poses, intrinsics, scene, episode_rng)
    if darkness > 0:
        trajectories[LAMP] = lamp_trajectory(frames, episode_rng)
    if scenario.outside_fov and hard and scene.cloth is not None:
        camera_poses = pan_aside(camera_poses, scenario.severity)  # a cloth on the table cannot be carried away
    script = _Script(motion, actor, intrinsics, camera_poses, trajectories)
    return _play(spec, scene, script, episode_rng, settings.stride)


@final
@dataclass(frozen=True, eq=False)
class _Script:
    """Everything that moves in a recording, frame by frame."""

    motion: ScriptedMotion
    actor: Actor
    intrinsics: PinholeCamera
    camera_poses: Trajectory
    trajectories: Mapping[str, Trajectory]


def _outside(
    intrinsics: PinholeCamera, camera_pose: Pose, scenario: ScenarioConfig, path: PathSpec
) -> Float64[np.ndarray, "3"]:
    """Return a point to the right of the image, far enough for an object of the usual size to be invisible there."""
    view = replace(intrinsics, pose=camera_pose)
    pixels, depth = project(view, path.start[None, :3, 3] + np.array([0.0, 0.0, path.height]))
    column = pixels[0, 0] + scenario.severity * (1.22 * intrinsics.width - pixels[0, 0])
    return np.asarray(back_project(view, np.array([[column, pixels[0, 1]]]), depth)[0])


def _occluder(
    scenario: ScenarioConfig,
    camera_poses: Trajectory,
    intrinsics: PinholeCamera,
    scene: TaskScene,
    episode_rng: np.random.Generator,
) -> Trajectory:
    corners = transform(scene.goal, scene.extent)
    coverage = min(1.0, 0.72 * scenario.severity)
    begin = episode_rng.uniform(0.05, 0.25)
    return occluder_trajectory(camera_poses, intrinsics, corners, Occlusion(coverage, begin, begin + 0.62), -1.0)


def _play(
    spec: mujoco.MjSpec, scene: TaskScene, script: _Script, episode_rng: np.random.Generator, stride: int
) -> Recording:
    """Move everything frame by frame, and render every ``stride``-th frame and the last one."""
    model = spec.compile()
    data = mujoco.MjData(model)
    motion, intrinsics, camera_poses = script.motion, script.intrinsics, script.camera_poses
    pictures, segmentations, depths, poses, vertices = [], [], [], [], []
    exposures = exposure_drift(len(camera_poses), episode_rng)
    rendered = sorted({*range(0, len(camera_poses), stride), len(camera_poses) - 1})
    scene.dynamics.start(model, data, motion.object_poses[0])
    with Renderer(model, intrinsics.width, intrinsics.height) as renderer:
        for frame in range(len(camera_poses)):
            _move(model, data, scene, script, frame)
            if frame not in rendered:
                continue
            pictures.append(compress(expose(renderer.picture(data), exposures[frame], episode_rng)))
            segmentations.append(encode_png((renderer.body_ids(data) + 2).astype(np.uint8)))
            depth = renderer.depth_m(data) / DEPTH_UNIT_M
            depths.append(encode_png(np.clip(depth + 0.5, 0, 65535).astype(np.uint16)))
            poses.append(_body_poses(data))
            if scene.cloth is not None:
                vertices.append(data.flexvert_xpos.copy())
    return Recording(
        pictures=pictures,
        segmentations=segmentations,
        depths=depths,
        bodies=[model.body(body_id).name for body_id in range(model.nbody)],
        poses=np.stack(poses),
        intrinsics=intrinsics,
        camera_poses=camera_poses[rendered],
        roles=(*scene.roles, *(RolePart(name, SceneRole.AGENT) for name in _attached_bodies(model, ACTOR))),
        cloth=None if scene.cloth is None else _cloth(model, scene.cloth, np.stack(vertices)),
    )


def _move(model: mujoco.MjModel, data: mujoco.MjData, scene: TaskScene, script: _Script, frame: int) -> None:
    """Move the camera, the actor, the environment and the object to their poses of a frame."""
    motion, object_pose = script.motion, script.motion.object_poses[frame]
    set_camera_pose(model, data, script.camera_poses[frame])
    script.actor.set_opening(model, data, float(motion.opening[frame]))
    retreat = pose((0.0, float(motion.retreat_m[frame]), 0.0))
    set_body_pose(model, data, ACTOR, object_pose @ scene.grip.pose @ retreat)
    for body, trajectory in script.trajectories.items():
        set_body_pose(model, data, body, trajectory[frame])
    scene.dynamics.move(model, data, object_pose, bool(motion.held[frame]), 1 / FRAME_RATE)


def _cloth(model: mujoco.MjModel, name: str, vertices: Float64[np.ndarray, "frames v 3"]) -> Cloth:
    """Return the cloth, whose rest state is the model's initial state in the frame of the body of the same name."""
    flat = mujoco.MjData(model)
    mujoco.mj_forward(model, flat)
    rest = transform(inverse(_body_poses(flat)[model.body(name).id]), flat.flexvert_xpos)
    return Cloth(name, rest, model.flex_elem.reshape(-1, 3).copy(), vertices)


def _body_poses(data: mujoco.MjData) -> Float64[np.ndarray, "bodies 4 4"]:
    matrices = np.repeat(np.eye(4)[None], len(data.xpos), axis=0)
    matrices[:, :3, :3] = data.xmat.reshape(-1, 3, 3)
    matrices[:, :3, 3] = data.xpos
    return matrices


def _attached_bodies(model: mujoco.MjModel, body: str) -> list[str]:
    """Return the names of a body and of all bodies that are attached to it."""
    root = model.body(body).id
    return [model.body(body_id).name for body_id in range(model.nbody) if model.body(body_id).rootid[0] == root]
