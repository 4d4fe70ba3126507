"""A scene that can be stepped: the object is led, and the camera shows what has become of it."""

from dataclasses import replace
from functools import cached_property
from types import TracebackType
from typing import final

import mujoco
import numpy as np
from jaxtyping import Float32, Float64, Int16

from geoskill.config import ScenarioConfig
from geoskill.errors import InputError
from geoskill.geometry.camera import PinholeCamera
from geoskill.geometry.poses import Pose, inverse, pose, transform
from geoskill.simulation.actors.actor import BODY as ACTOR
from geoskill.simulation.contact import HOLD, SolidObject, add_contact, body_pose, contact_forces
from geoskill.simulation.placement import GoalDistance, distance_to_goal
from geoskill.simulation.recording import DEPTH_UNIT_M, FRAME_RATE, Cloth, Recording, decode_picture, encode_png
from geoskill.simulation.renderer import CAMERA, Renderer, set_camera_pose
from geoskill.simulation.roles import SceneRole
from geoskill.simulation.script import write_script
from geoskill.simulation.sensor import Image, compress, expose
from geoskill.simulation.shapes import set_body_pose
from geoskill.simulation.tasks.task import RigidObject, RolePart, Task


@final
class Stage:
    """A task's scene, with a held object that is led anywhere; to be closed after use, preferably by ``with``.

    At first the object is at its start. Surroundings, which are the camera's pose, an occluder, a moving lamp and the
    exposure, are those of the first frame of the task's demonstration until :meth:`surround` moves them on. Equal
    arguments and calls give equal pictures.

    Args:
        task: the task that the scene is for.
        scenario: who holds the object, and which difficulties there are.
        seed: of the appearance of things: prints and colors.
        episode: its name seeds everything else, such as placements.
        second_camera: whether another camera looks from the right; pictures of the first do not change.
        contact: whether the object is stopped by what it touches, and falls when it is let go.

    Attributes:
        scene: the task in the scene: the object's start and goal, the grip, the roles.
        motion: of object and actor in the task's demonstration, frame by frame; :meth:`lead` may follow it.

    Raises:
        InputError: when ``seed`` is negative, or ``contact`` is asked for and nothing stops the task's object; also
            when something is rendered without an OpenGL context available.
    """

    def __init__(
        self,
        task: Task,
        scenario: ScenarioConfig,
        seed: int,
        episode: str,
        *,
        second_camera: bool = False,
        contact: bool = False,
    ) -> None:
        if seed < 0:
            raise InputError(f"seed={seed}: expected 0 or more for a simulated task")
        self._script = script = write_script(task, scenario, seed, episode, second_camera=second_camera)
        self.scene = script.scene
        self.motion = script.motion
        self._dynamics = add_contact(script.spec, task.name, script.scene) if contact else script.scene.dynamics
        self._model = script.spec.compile()
        self._data = mujoco.MjData(self._model)
        self._frame = 0
        self._jpegs: dict[str, bytes] = {}
        self.put(self.motion.object_poses[0])
        self.surround(0)

    @cached_property
    def _renderer(self) -> Renderer:
        # Made when something is to be rendered: a stage can be led where there is no OpenGL.
        return Renderer(self._model, self._script.intrinsics.width, self._script.intrinsics.height)

    def __enter__(self) -> "Stage":
        return self

    def __exit__(
        self, error_type: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Release the OpenGL context, if there is one; MuJoCo can fail when another one is created before."""
        if "_renderer" in vars(self):
            self._renderer.close()

    def __len__(self) -> int:
        """Return the number of frames of the task's demonstration."""
        return len(self._script)

    def surround(self, frame: int) -> None:
        """Move the camera, the occluder and the lamp to a frame of the demonstration, after its end to the last."""
        self._frame = frame = min(frame, len(self) - 1)
        for name, trajectory in self._script.camera_poses.items():
            set_camera_pose(self._model, self._data, trajectory[frame], name)
        for body, trajectory in self._script.trajectories.items():
            set_body_pose(self._model, self._data, body, trajectory[frame])
        self._update()

    def put(self, object_pose: Pose) -> None:
        """Put the object and the actor that holds it at a pose at once, whatever is between."""
        self._dynamics.start(self._model, self._data, object_pose)
        self._place_actor(object_pose, 0.0, 0.0)
        self._update()

    def lead(
        self,
        object_pose: Pose,
        held: bool = True,
        opening: float = 0.0,
        retreat_m: float = 0.0,
        seconds: float = 1 / FRAME_RATE,
    ) -> None:
        """Move the object and the actor that holds it; with contact, both stop where the object presses on something.

        Args:
            object_pose: where the object is to be, in the world.
            held: whether the actor still holds it.
            opening: of the fingers, from 0 to 1.
            retreat_m: distance of the actor from where it holds the object, along its arm.
            seconds: time that the movement takes.
        """
        self._place_actor(object_pose, opening, retreat_m)
        self._dynamics.move(self._model, self._data, object_pose, held, seconds)
        if held and isinstance(self._dynamics, SolidObject):
            self._place_actor(body_pose(self._model, self._data, HOLD), opening, retreat_m)
        self._update()

    def touched(self) -> dict[str, float]:
        """Return the bodies that the object touches, with their normal forces on it, newtons; none without contact."""
        return contact_forces(self._model, self._data)

    def distance_to_goal(self, camera: str = CAMERA) -> GoalDistance:
        """Return how far the object is from its goal, as a camera sees it.

        Raises:
            ValueError: when the object is a cloth.
        """
        if not isinstance(self._dynamics, RigidObject | SolidObject):
            raise ValueError(f"{self.scene.cloth} is a cloth; expected a rigid object")
        present = body_pose(self._model, self._data, self._dynamics.body)
        return distance_to_goal(present, self.scene, self.view(camera))

    def picture(self, camera: str = CAMERA) -> Image:
        """Return the RGB image that a camera delivers: with blur, exposure, noise and compression.

        It is the same until something moves; then even what is at rest has new noise.
        """
        return decode_picture(self._compressed(camera))

    def depth_m(self, camera: str = CAMERA) -> Float32[np.ndarray, "height width"]:
        """Return the true depth of each pixel along a camera's axis, meters."""
        return self._renderer.depth_m(self._data, camera)

    def body_ids(self, camera: str = CAMERA) -> Int16[np.ndarray, "height width"]:
        """Return the id of the body that is visible at each pixel: -1 for the cloth, -2 for none."""
        return self._renderer.body_ids(self._data, camera)

    def bodies(self) -> list[str]:
        """Return the names of the bodies, by id."""
        return [self._model.body(body_id).name for body_id in range(self._model.nbody)]

    def poses(self) -> Float64[np.ndarray, "bodies 4 4"]:
        """Return the world poses of all bodies, by id."""
        return _body_poses(self._data)

    @property
    def cameras(self) -> tuple[str, ...]:
        """The names of the cameras, the recording one first."""
        return tuple(self._script.camera_poses)

    @property
    def camera(self) -> PinholeCamera:
        """The recording camera at its pose."""
        return self.view(CAMERA)

    def view(self, camera: str) -> PinholeCamera:
        """Return a camera at its pose."""
        return replace(self._script.intrinsics, pose=self._script.camera_poses[camera][self._frame])

    @property
    def roles(self) -> tuple[RolePart, ...]:
        """The parts of bodies that are the object, the target or the agent; the first that contains a point counts."""
        root = self._model.body(ACTOR).id
        attached = [self._model.body(body_id) for body_id in range(self._model.nbody)]
        return (
            *self.scene.roles,
            *(RolePart(body.name, SceneRole.AGENT) for body in attached if body.rootid[0] == root),
        )

    def shot(self, camera: str = CAMERA) -> Recording:
        """Return a recording of one frame, the present one, by one camera.

        With it, :class:`~geoskill.simulation.ground_truth.FrameGroundTruth` and all else that knows recordings judges
        what a stage shows; the goal is a shot after the object has been led there.
        """
        depth = self.depth_m(camera) / DEPTH_UNIT_M
        return Recording(
            pictures=[self._compressed(camera)],
            segmentations=[encode_png((self.body_ids(camera) + 2).astype(np.uint8))],
            depths=[encode_png(np.clip(depth + 0.5, 0, 65535).astype(np.uint16))],
            bodies=self.bodies(),
            poses=self.poses()[None],
            intrinsics=self._script.intrinsics,
            camera_poses=self.view(camera).pose[None],
            roles=self.roles,
            cloth=None if self.scene.cloth is None else self._cloth(self.scene.cloth),
        )

    def _compressed(self, camera: str) -> bytes:
        if camera not in self._jpegs:
            rendered = self._renderer.picture(self._data, camera)
            exposure = float(self._script.exposures[self._frame])
            self._jpegs[camera] = compress(expose(rendered, exposure, self._script.episode_rng))
        return self._jpegs[camera]

    def _place_actor(self, object_pose: Pose, opening: float, retreat_m: float) -> None:
        self._script.actor.set_opening(self._model, self._data, opening)
        retreat = pose((0.0, retreat_m, 0.0))
        set_body_pose(self._model, self._data, ACTOR, object_pose @ self.scene.grip.pose @ retreat)

    def _update(self) -> None:
        """Compute what the renderer shows; no dynamics, whose solver starts from where it last was."""
        mujoco.mj_kinematics(self._model, self._data)
        mujoco.mj_camlight(self._model, self._data)
        self._jpegs.clear()

    def _cloth(self, name: str) -> Cloth:
        triangles = self._model.flex_elem.reshape(-1, 3).copy()
        return Cloth(name, self._cloth_rest, triangles, self._data.flexvert_xpos.copy()[None])

    @cached_property
    def _cloth_rest(self) -> Float64[np.ndarray, "vertices 3"]:
        """The model's initial state in the frame of the body with the cloth's name."""
        flat = mujoco.MjData(self._model)
        mujoco.mj_forward(self._model, flat)
        in_world = _body_poses(flat)[self._model.body(str(self.scene.cloth)).id]
        return transform(inverse(in_world), flat.flexvert_xpos)


def _body_poses(data: mujoco.MjData) -> Float64[np.ndarray, "bodies 4 4"]:
    matrices = np.repeat(np.eye(4)[None], len(data.xpos), axis=0)
    matrices[:, :3, :3] = data.xmat.reshape(-1, 3, 3)
    matrices[:, :3, 3] = data.xpos
    return matrices
