"""The renderer, on a scene whose pixels are computed by hand."""

import os
import subprocess
import sys
from pathlib import Path

import mujoco
import numpy as np
import pytest

import geoskill
from geoskill.errors import InputError
from geoskill.geometry.camera import project
from geoskill.geometry.poses import pose
from geoskill.simulation.renderer import (
    SYSTEM_PACKAGES,
    VERTICAL_VIEW_DEG,
    Renderer,
    add_camera,
    camera_intrinsics,
    set_camera_pose,
)
from geoskill.simulation.shapes import add_box

WIDTH, HEIGHT = 161, 121
# Looks down from 1 m, with the world's x to the right.
ABOVE = pose((0.0, 0.0, 1.0), np.diag([1.0, -1.0, -1.0]))


def slab() -> mujoco.MjModel:
    """Return a red slab with its top at z = 0.2, from x = 0.1 to 0.3 and from y = -0.05 to 0.15."""
    spec = mujoco.MjSpec()
    add_camera(spec, WIDTH, HEIGHT)
    spec.visual.headlight.ambient = [1.0] * 3
    body = spec.worldbody.add_body(name="slab")
    add_box(body, (0.1, 0.1, 0.1), pose((0.2, 0.05, 0.1)), color=(1, 0, 0))
    return spec.compile()


def test_renderer_without_a_context_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: object) -> None:
        raise RuntimeError("invalid value for environment variable MUJOCO_GL")

    monkeypatch.setattr(mujoco, "Renderer", fail)
    with pytest.raises(InputError) as error:
        Renderer(slab(), WIDTH, HEIGHT)
    message = str(error.value)
    assert message.startswith("no OpenGL context for rendering (RuntimeError: invalid value for environment variable")
    assert f"sudo apt-get install {SYSTEM_PACKAGES}" in message


def test_import_without_opengl_libraries_succeeds_and_rendering_fails() -> None:
    program = """
import ctypes.util
real = ctypes.util.find_library
ctypes.util.find_library = lambda name: None if name == "EGL" else real(name)
import geoskill.simulation.scene
import mujoco
from geoskill.errors import InputError
from geoskill.simulation.renderer import Renderer
try:
    Renderer(mujoco.MjSpec().compile(), 64, 48)
except InputError as error:
    print(error)
"""
    environment = {name: value for name, value in os.environ.items() if name != "MUJOCO_GL"}
    environment["PYTHONPATH"] = str(Path(geoskill.__file__).parents[1])
    completed = subprocess.run(
        [sys.executable, "-c", program], env=environment, capture_output=True, text=True, check=True
    )
    assert completed.stdout.startswith("no OpenGL context for rendering")
    assert completed.stdout.endswith(f"sudo apt-get install {SYSTEM_PACKAGES}\n")


@pytest.mark.usefixtures("opengl")
@pytest.mark.parametrize("backend", ["no-such", "glx", "disable"])
def test_backend_that_cannot_work_is_named(backend: str) -> None:
    program = """
import os
import geoskill.simulation.scene
import mujoco
from geoskill.errors import InputError
from geoskill.simulation.renderer import Renderer
try:
    Renderer(mujoco.MjSpec().compile(), 64, 48)
except InputError as error:
    print(error)
print(os.environ["MUJOCO_GL"])
"""
    environment = {name: value for name, value in os.environ.items() if name not in ("DISPLAY", "WAYLAND_DISPLAY")}
    environment |= {"PYTHONPATH": str(Path(geoskill.__file__).parents[1]), "MUJOCO_GL": backend}
    completed = subprocess.run(
        [sys.executable, "-c", program], env=environment, capture_output=True, text=True, check=True
    )
    message, left = completed.stdout.splitlines()
    assert message.startswith(f"MUJOCO_GL={backend}: no OpenGL context for rendering (")
    assert message.endswith("); expected MUJOCO_GL=egl, or the variable not to be set")
    assert left == backend


def test_camera_intrinsics_match_the_vertical_field_of_view() -> None:
    camera = camera_intrinsics(640, 480)
    slope = np.tan(np.radians(VERTICAL_VIEW_DEG / 2))
    pixels, _ = project(camera, np.array([[0.0, -slope, 1.0], [0.0, slope, 1.0]]))
    np.testing.assert_allclose(pixels[:, 1], [-0.5, 479.5])


@pytest.mark.usefixtures("opengl")
def test_renderer_agrees_with_the_pinhole_camera() -> None:
    model = slab()
    data = mujoco.MjData(model)
    set_camera_pose(model, data, ABOVE)
    mujoco.mj_forward(model, data)
    with Renderer(model, WIDTH, HEIGHT) as renderer:
        body_ids, depth, picture = renderer.body_ids(data), renderer.depth_m(data), renderer.picture(data)
        np.testing.assert_array_equal(renderer.body_ids(data), body_ids)  # the modes do not disturb each other
    # Pixels per meter at a depth of 0.8 m; the center of the image is pixel (80, 60).
    scale = 121 / 2 / np.tan(np.radians(20)) / 0.8
    left, right, top, bottom = 80 + 0.1 * scale, 80 + 0.3 * scale, 60 - 0.15 * scale, 60 + 0.05 * scale
    foot = 80 + 0.1 * scale * 0.8  # the left side is visible, too, down to the ground at a depth of 1 m
    rows, columns = np.nonzero(body_ids == model.body("slab").id)
    np.testing.assert_allclose(
        [columns.min(), columns.max(), rows.min(), rows.max()], [foot, right, top, bottom], atol=1
    )
    inside = np.s_[int(top) + 2 : int(bottom) - 1, int(left) + 2 : int(right) - 1]
    np.testing.assert_allclose(depth[inside], 0.8, atol=1e-4)
    assert np.all(picture[inside].argmax(axis=-1) == 0)
    assert np.all(body_ids[:, : int(foot) - 1] == -2)
