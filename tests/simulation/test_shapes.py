"""Materials and shapes: an image on a box is upright and not mirrored on any face."""

import mujoco
import numpy as np
import pytest

from geoskill.geometry.camera import look_at
from geoskill.geometry.poses import pose
from geoskill.simulation.renderer import Renderer, add_camera, set_camera_pose
from geoskill.simulation.shapes import add_box, add_capsule, add_cylinder, add_material, add_mocap_body, add_printed_box

RED, GREEN, BLUE, WHITE = (230, 20, 20), (20, 230, 20), (20, 20, 230), (230, 230, 230)


def quarters() -> np.ndarray:
    """Return an image with red and green above blue and white."""
    image = np.zeros((64, 64, 3), np.uint8)
    image[:32, :32], image[:32, 32:], image[32:, :32], image[32:, 32:] = RED, GREEN, BLUE, WHITE
    return image


def nearest_color(pixel: np.ndarray) -> tuple[int, ...]:
    level = pixel.astype(float) * 230 / max(1.0, float(pixel.max()))
    return min((RED, GREEN, BLUE, WHITE), key=lambda color: float(np.abs(level - color).sum()))


@pytest.mark.usefixtures("opengl")
@pytest.mark.parametrize(
    ("face", "camera"),
    [
        # Seen from above, y is up in the image.
        ("+z", pose((0.0, 0.0, 0.5), np.diag([1.0, -1.0, -1.0]))),
        ("-y", look_at(np.array([0.0, -0.5, 0.0]), np.zeros(3))),
        ("+y", look_at(np.array([0.0, 0.5, 0.0]), np.zeros(3))),
        ("+x", look_at(np.array([0.5, 0.0, 0.0]), np.zeros(3))),
        ("-x", look_at(np.array([-0.5, 0.0, 0.0]), np.zeros(3))),
    ],
)
def test_printed_box_shows_images_upright_and_not_mirrored(face: str, camera: np.ndarray) -> None:
    spec = mujoco.MjSpec()
    add_camera(spec, 101, 81)
    spec.visual.headlight.ambient = [0.8] * 3
    material = add_material(spec, "print", quarters(), shine=0.0)
    box = add_mocap_body(spec, "box")
    add_printed_box(box, (0.05, 0.05, 0.05), {face: material}, (0, 0, 0), np.eye(4))
    model = spec.compile()
    data = mujoco.MjData(model)
    set_camera_pose(model, data, camera)
    mujoco.mj_forward(model, data)
    with Renderer(model, 101, 81) as renderer:
        picture = renderer.picture(data)
    # The face extends by some 24 px to either side of the center, pixel (50, 40).
    colors = [nearest_color(picture[row, column]) for row in (30, 50) for column in (40, 60)]
    assert colors == [RED, GREEN, BLUE, WHITE]


def test_shapes_have_their_poses_and_sizes_and_do_not_collide() -> None:
    spec = mujoco.MjSpec()
    body = add_mocap_body(spec, "body", pose((1.0, 2.0, 3.0)))
    add_box(body, (0.1, 0.2, 0.3), pose((0.5, 0.0, 0.0)), color=(0.25, 0.5, 0.75))
    add_capsule(body, (0, 0, 0), (0, 0, 0.4), 0.05)
    add_cylinder(body, (0, -0.3, 0), (0, 0.1, 0), 0.02)
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    np.testing.assert_allclose(data.geom_xpos, [[1.5, 2, 3], [1, 2, 3.2], [1, 1.9, 3]], atol=1e-9)
    np.testing.assert_allclose(model.geom_size[0], [0.1, 0.2, 0.3])
    np.testing.assert_allclose(model.geom_size[1:, :2], [[0.05, 0.2], [0.02, 0.2]])
    np.testing.assert_allclose(model.geom_rgba[0], [0.25, 0.5, 0.75, 1])
    np.testing.assert_array_equal(model.geom_contype | model.geom_conaffinity, 0)
