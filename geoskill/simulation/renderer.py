"""Color images, segmentation and depth of a MuJoCo scene, rendered without a display."""

from types import TracebackType
from typing import final

import mujoco
import numpy as np
from jaxtyping import Float32, Int16, UInt8

from geoskill.errors import InputError
from geoskill.geometry.camera import PinholeCamera, focal_length_px
from geoskill.geometry.poses import Pose, pose
from geoskill.simulation import REQUESTED_GL, has_libraries
from geoskill.simulation.shapes import add_mocap_body, set_body_pose

CAMERA, SECOND_CAMERA = "camera", "second_camera"
VERTICAL_VIEW_DEG = 40.0
SYSTEM_PACKAGES = "libegl1 libgl1 libgl1-mesa-dri"


def add_camera(spec: mujoco.MjSpec, width: int, height: int, name: str = CAMERA) -> None:
    """Add a camera, by default the recording one, whose pose :func:`set_camera_pose` sets on every frame."""
    spec.visual.global_.offwidth, spec.visual.global_.offheight = width, height
    spec.visual.quality.shadowsize = 4096
    spec.visual.quality.offsamples = 4
    spec.visual.map.znear = 0.05
    # The extent is the area around the center in which shadows are computed; the wider, the coarser they are.
    spec.stat.center, spec.stat.extent = [0.0, 0.0, 0.0], 1.0
    add_mocap_body(spec, name).add_camera(name=name, fovy=VERTICAL_VIEW_DEG, pos=[0, 0, 0])


def camera_intrinsics(width: int, height: int) -> PinholeCamera:
    """Return the recording camera at the origin."""
    return PinholeCamera(width, height, focal_length_px(height, float(np.radians(VERTICAL_VIEW_DEG))), np.eye(4))


def set_camera_pose(model: mujoco.MjModel, data: mujoco.MjData, camera_pose: Pose, name: str = CAMERA) -> None:
    """Set a camera's pose; MuJoCo's cameras look along -z with y up, :class:`PinholeCamera` along z with y down."""
    set_body_pose(model, data, name, camera_pose @ pose((0.0, 0.0, 0.0), np.diag([1.0, -1.0, -1.0])))


@final
class Renderer:
    """An offscreen renderer of one model, seen by any of its cameras, to be closed after use, preferably by ``with``.

    Args:
        model: to be rendered.
        width: of the images, pixels.
        height: of the images, pixels.

    Raises:
        InputError: when no OpenGL context is available; names the variable that asks for one which is not there, or
            the system packages that provide one.
    """

    def __init__(self, model: mujoco.MjModel, width: int, height: int) -> None:
        self._model = model
        try:
            self._renderer = mujoco.Renderer(model, height, width)
        except Exception as error:  # every platform raises errors of its own
            problem = f"no OpenGL context for rendering ({type(error).__name__}: {error})"
            if REQUESTED_GL not in (None, "egl") and has_libraries("egl"):
                raise InputError(
                    f"MUJOCO_GL={REQUESTED_GL}: {problem}; expected MUJOCO_GL=egl, or the variable not to be set"
                ) from error
            raise InputError(f"{problem}; expected EGL: sudo apt-get install {SYSTEM_PACKAGES}") from error

    def __enter__(self) -> "Renderer":
        return self

    def __exit__(
        self, error_type: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Release the OpenGL context; MuJoCo can fail when another one is created before."""
        self._renderer.close()

    def picture(self, data: mujoco.MjData, camera: str = CAMERA) -> UInt8[np.ndarray, "height width 3"]:
        """Render an RGB image."""
        self._renderer.update_scene(data, camera)
        return np.array(self._renderer.render())

    def body_ids(self, data: mujoco.MjData, camera: str = CAMERA) -> Int16[np.ndarray, "height width"]:
        """Render the id of the body that is visible at each pixel: -1 for a flexible body, -2 for none."""
        self._renderer.enable_segmentation_rendering()
        self._renderer.update_scene(data, camera)
        ids, types = np.moveaxis(self._renderer.render(), -1, 0)
        self._renderer.disable_segmentation_rendering()
        bodies = np.full(ids.shape, -2, np.int16)
        is_geom = types == int(mujoco.mjtObj.mjOBJ_GEOM)  # NumPy would compare with the enum itself pixel by pixel
        bodies[is_geom] = self._model.geom_bodyid[ids[is_geom]]
        bodies[types == int(mujoco.mjtObj.mjOBJ_FLEX)] = -1
        return bodies

    def depth_m(self, data: mujoco.MjData, camera: str = CAMERA) -> Float32[np.ndarray, "height width"]:
        """Render the depth of each pixel along the camera's axis, meters."""
        self._renderer.enable_depth_rendering()
        self._renderer.update_scene(data, camera)
        depth = self._renderer.render().copy()
        self._renderer.disable_depth_rendering()
        return np.asarray(depth, np.float32)
