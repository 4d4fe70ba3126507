"""Everything that is drawn for a scene: its things, the demonstrator's motion, the camera's and the surroundings'."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import final

import mujoco
import numpy as np
from jaxtyping import Float64

from geoskill.config import ScenarioConfig
from geoskill.geometry.camera import PinholeCamera, back_project, project
from geoskill.geometry.poses import Pose, transform
from geoskill.simulation.actors.actor import Actor
from geoskill.simulation.actors.gripper import Gripper
from geoskill.simulation.actors.hand import Hand
from geoskill.simulation.conditions import (
    SECOND_CAMERA_POSITION,
    START_RANGE,
    camera_trajectory,
    pan_aside,
    target_range,
)
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
from geoskill.simulation.renderer import CAMERA, SECOND_CAMERA, add_camera, camera_intrinsics
from geoskill.simulation.sensor import exposure_drift
from geoskill.simulation.tasks.task import PlanarPose, Task, TaskScene

WIDTH, HEIGHT = 640, 480

Trajectory = Float64[np.ndarray, "frames 4 4"]


@final
@dataclass(frozen=True, eq=False)
class Script:
    """A scene with all that moves in it, frame by frame.

    Attributes:
        spec: the scene, not yet compiled.
        scene: the task in it.
        actor: who moves the object.
        motion: of the object and the actor in the task's demonstration.
        intrinsics: the camera at the origin.
        camera_poses: of each camera in the world, by its name; the recording one is the first.
        trajectories: world poses of the occluder and the moving lamp, where there are any, by body.
        exposures: factors on the intensity.
        episode_rng: draws the noise of the pictures, after everything else has been drawn.
    """

    spec: mujoco.MjSpec
    scene: TaskScene
    actor: Actor
    motion: ScriptedMotion
    intrinsics: PinholeCamera
    camera_poses: Mapping[str, Trajectory]
    trajectories: Mapping[str, Trajectory]
    exposures: Float64[np.ndarray, " frames"]
    episode_rng: np.random.Generator

    def __len__(self) -> int:
        return len(self.exposures)


def write_script(task: Task, scenario: ScenarioConfig, seed: int, episode: str, *, second_camera: bool) -> Script:
    """Draw a scene; equal arguments give equal scenes.

    Args:
        task: the task to perform.
        scenario: who performs it, and which difficulties there are.
        seed: of the appearance of things: prints and colors.
        episode: its name seeds everything else, such as placements, path and speed.
        second_camera: whether another camera looks from the right; it changes nothing for the first.
    """
    # The strings only seed the generators; changing one, or the order of draws, changes every recording.
    episode_rng = generator(seed, task.name, "take", episode)
    frames = int(episode_rng.integers(80, 111))
    spec = mujoco.MjSpec()
    add_camera(spec, WIDTH, HEIGHT)
    darkness = 0.0 if not scenario.illumination else scenario.severity
    add_table(spec, generator(seed, "table", episode if scenario.random_target else "usual"))
    add_light(spec, min(1.0, darkness), generator(seed, "light", episode))
    scene = task.build(
        spec,
        target_range(scenario).sample_around(PlanarPose(0, 0, 0), episode_rng),
        START_RANGE.sample_around(PlanarPose(0, 0, 0), episode_rng),
        generator(seed, task.name, "looks"),
        episode_rng,
    )
    actor: Actor = Hand() if scenario.actor == "human" else Gripper()
    actor.add(spec, scene.grip, generator(seed, "actor", episode))
    intrinsics = camera_intrinsics(WIDTH, HEIGHT)
    camera_poses = camera_trajectory(scenario, frames, episode_rng)
    leaves = scenario.outside_fov and scenario.severity > 0
    path = PathSpec(scene.start, scene.goal, scene.approach, scene.height)
    if leaves and scene.cloth is None:
        path = replace(path, detour=_outside(intrinsics, camera_poses[0], scenario, path))
    if scenario.actor == "human":
        motion = human_motion(path, frames, scenario.confidence, episode_rng)
    else:
        motion = robot_motion(path, frames)
    trajectories: dict[str, Trajectory] = {}
    if scenario.occlusion and scenario.severity > 0:
        add_occluder(spec, generator(seed, "cover", episode))
        trajectories[OCCLUDER] = _occluder(scenario, camera_poses, intrinsics, scene, episode_rng)
    if darkness > 0:
        trajectories[LAMP] = lamp_trajectory(frames, episode_rng)
    if leaves and scene.cloth is not None:
        camera_poses = pan_aside(camera_poses, scenario.severity)  # a cloth on the table cannot be carried away
    exposures = exposure_drift(frames, episode_rng)
    cameras = {CAMERA: camera_poses}
    if second_camera:
        add_camera(spec, WIDTH, HEIGHT, SECOND_CAMERA)
        rng = generator(seed, "second camera", episode)
        cameras[SECOND_CAMERA] = camera_trajectory(scenario, frames, rng, SECOND_CAMERA_POSITION)
    return Script(spec, scene, actor, motion, intrinsics, cameras, trajectories, exposures, episode_rng)


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
