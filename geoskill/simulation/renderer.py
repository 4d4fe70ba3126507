"""Pictures, bodies and depths of a MuJoCo scene, without a display."""

from types import TracebackType
from typing import final

import mujoco
import numpy as np
from jaxtyping import Float32, Int16, UInt8

from geoskill.errors import InputError
from geoskill.geometry.camera import PinholeCamera, focal_length_px
from geoskill.geometry.poses import pose
from geoskill.simulation.parts import moving_body, place

CAMERA = "camera"
VERTICAL_VIEW_DEG = 40.0
SYSTEM_PACKAGES = "libegl1 libgl1 libgl1-mesa-dri"


def add_camera(spec: mujoco.MjSpec, width: int, height: int) -> None:
    """The recording camera, whose pose is set on every frame."""
    spec.visual.global_.offwidth, spec.visual.global_.offheight = width, height
    spec.visual.quality.shadowsize = 4096
    spec.visual.quality.offsamples = 4
    spec.visual.map.znear = 0.05
    # Shadows are computed for what lies so far around the middle of the scene; the wider, the coarser.
    spec.stat.center, spec.stat.extent = [0.0, 0.0, 0.0], 1.0
    moving_body(spec, CAMERA).add_camera(name=CAMERA, fovy=VERTICAL_VIEW_DEG, pos=[0, 0, 0])


def lens(width: int, height: int) -> PinholeCamera:
    """The camera's intrinsics, at the origin."""
    return PinholeCamera(width, height, focal_length_px(height, float(np.radians(VERTICAL_VIEW_DEG))), np.eye(4))


def place_camera(model: mujoco.MjModel, data: mujoco.MjData, matrix: np.ndarray) -> None:
    """Put the camera where it belongs; MuJoCo's looks along -z with y up, ours along z with y down."""
    place(model, data, CAMERA, matrix @ pose((0.0, 0.0, 0.0), np.diag([1.0, -1.0, -1.0])))


@final
class Renderer:
    """Renders one model; to be closed, best by ``with``.

    Raises:
        InputError: where no OpenGL context can be had; names the system packages that bring one.
    """

    def __init__(self, model: mujoco.MjModel, width: int, height: int) -> None:
        self._model = model
        try:
            self._renderer = mujoco.Renderer(model, height, width)
        except Exception as error:  # every platform has errors of its own
            raise InputError(
                f"no OpenGL context for rendering ({type(error).__name__}: {error}); expected EGL:"
                f" sudo apt-get install {SYSTEM_PACKAGES}"
            ) from error

    def __enter__(self) -> "Renderer":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Give the context back; MuJoCo can fail when another is made before."""
        self._renderer.close()

    def picture(self, data: mujoco.MjData) -> UInt8[np.ndarray, "height width 3"]:
        """RGB."""
        self._renderer.update_scene(data, CAMERA)
        return np.array(self._renderer.render())

    def bodies(self, data: mujoco.MjData) -> Int16[np.ndarray, "height width"]:
        """The number of the body that each pixel shows: -1 a flexible part, -2 nothing."""
        self._renderer.enable_segmentation_rendering()
        self._renderer.update_scene(data, CAMERA)
        ids, kinds = np.moveaxis(self._renderer.render(), -1, 0)
        self._renderer.disable_segmentation_rendering()
        shown = np.full(ids.shape, -2, np.int16)
        geoms = kinds == int(mujoco.mjtObj.mjOBJ_GEOM)  # NumPy would compare an enum item by item
        shown[geoms] = self._model.geom_bodyid[ids[geoms]]
        shown[kinds == int(mujoco.mjtObj.mjOBJ_FLEX)] = -1
        return shown

    def depth_m(self, data: mujoco.MjData) -> Float32[np.ndarray, "height width"]:
        """Along the camera's axis."""
        self._renderer.enable_depth_rendering()
        self._renderer.update_scene(data, CAMERA)
        depth = self._renderer.render().copy()
        self._renderer.disable_depth_rendering()
        return np.asarray(depth, np.float32)
