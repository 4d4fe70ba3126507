"""Ring: a cup is put onto a round mark that is as wide as its base."""

from typing import ClassVar, final

import cv2
import mujoco
import numpy as np
from jaxtyping import UInt8

from geoskill.geometry.poses import pose, rotation_about, table_pose
from geoskill.simulation.actors.actor import Grip
from geoskill.simulation.roles import SceneRole
from geoskill.simulation.shapes import add_band, add_box, add_cylinder, add_material, add_mocap_body
from geoskill.simulation.tasks.task import PlanarPose, RigidObject, RolePart, Task, TaskScene
from geoskill.simulation.textures import print_on_card

Picture = UInt8[np.ndarray, "height width 3"]

# The cup's frame is at the middle of its base, with the z axis up along its axis.
# It is narrower at the top, so that the camera sees its wall in better light.
RADIUS, TOP_RADIUS, HEIGHT, WALL = 0.036, 0.026, 0.055, 0.0015
DRINK = 0.046  # height of what is in it
# Height of the row of tiles along its base, which are what comes to lie on the mark.
BAND = 0.006
# The mat's frame is on the table, below the middle of its mark: a ring, around the cup when it is on it.
HALF_MAT, HALF_THICKNESS = 0.064, 0.0015
RING_INNER, RING_OUTER = 0.0365, 0.0445
OBJECT, TARGET = "cup", "mat"
PIXELS = 1024


@final
class Ring(Task):
    """A task with a printed mat that has a ring, and a smaller one on another mat, a distractor."""

    name: ClassVar[str] = "ring"

    def build(
        self,
        spec: mujoco.MjSpec,
        target: PlanarPose,
        start: PlanarPose,
        appearance_rng: np.random.Generator,
        episode_rng: np.random.Generator,
    ) -> TaskScene:
        """See :meth:`Task.build`."""
        mat = table_pose(-0.085 + target.x, 0.015 + target.y, 0.1 + target.yaw_rad)
        _add_mats(spec, mat, appearance_rng)
        _add_cup(spec, appearance_rng)
        bar = add_mocap_body(spec, "distractor_bar", table_pose(-0.01, -0.19, 0.3, 0.010))
        add_box(bar, (0.038, 0.012, 0.010), np.eye(4), color=tuple(appearance_rng.uniform(0.2, 0.7, 3)))
        grip_pose = pose(
            (0.0, episode_rng.uniform(-0.003, 0.003), episode_rng.uniform(0.028, 0.034)),
            rotation_about(np.array([0.0, 0.0, episode_rng.uniform(-0.2, 0.15)])),
        )
        corners = [(x, y, 0.0) for x in (-RING_OUTER, RING_OUTER) for y in (-RING_OUTER, RING_OUTER)]
        return TaskScene(
            start=table_pose(0.185 + start.x, -0.06 + start.y, start.yaw_rad, 0.001),
            goal=mat @ pose((0.0, 0.0, 2 * HALF_THICKNESS)),
            approach=np.array([0.0, 0.0, 0.05]),
            height=0.07,
            grip=Grip(grip_pose, 0.5 * (RADIUS + TOP_RADIUS)),
            dynamics=RigidObject(OBJECT),
            extent=np.array(corners),
            roles=(RolePart(OBJECT, SceneRole.OBJECT), RolePart(TARGET, SceneRole.TARGET)),
            free_axis=np.array([0.0, 0.0, 1.0]),
        )


def _add_mats(spec: mujoco.MjSpec, mat: np.ndarray, appearance_rng: np.random.Generator) -> None:
    """Add the mat with the mark, and one with a smaller ring, away from the path and from all placements of the mat."""
    # Their prints are paler than the cup's, which is in its own shade.
    for name, half_size, where, shapes, contrast, rings in (
        (TARGET, HALF_MAT, mat, 40, 0.5, (RING_INNER, RING_OUTER)),
        ("distractor_mat", 0.036, table_pose(-0.25, 0.20, -0.3), 5, 0.3, (0.016, 0.021)),
    ):
        paper = tuple(appearance_rng.uniform(180, 220, 3))
        ink = tuple(map(float, np.array(paper) * (1 - contrast) + contrast * appearance_rng.uniform(0, 90, 3)))
        card = print_on_card(appearance_rng, paper, shapes, contrast)
        image = _ring_print(card, paper, ink, rings, half_size)
        body = add_mocap_body(spec, name, where)
        half_thickness = pose((0, 0, HALF_THICKNESS))
        add_box(body, (half_size, half_size, HALF_THICKNESS), half_thickness, add_material(spec, name, image))


def _ring_print(
    card: Picture, paper: tuple[float, ...], ink: tuple[float, ...], rings: tuple[float, float], half_size: float
) -> UInt8[np.ndarray, "pixels pixels 3"]:
    """Return a card with a ring of ink, blank inside of it."""
    image = cv2.resize(card, (PIXELS, PIXELS), interpolation=cv2.INTER_CUBIC)
    middle = (round((PIXELS - 1) / 2 * 16),) * 2  # in sixteenths of a pixel
    for radius, color in ((rings[1] * 1.08, paper), (rings[1], ink), (rings[0], paper)):
        cv2.circle(image, middle, round(radius / half_size * PIXELS / 2 * 16), color, -1, cv2.LINE_AA, 4)
    return np.asarray(image)


def _add_cup(spec: mujoco.MjSpec, appearance_rng: np.random.Generator) -> None:
    """Add the cup: a printed wall with a row of tiles along its base, and a dark drink in it."""
    glaze = appearance_rng.uniform(230, 252, 3)
    # As wide as the wall, which is about four times as long as it is high.
    cards = [print_on_card(appearance_rng, tuple(glaze), 26)[16:376, 16:-16] for _ in range(3)]
    image = np.hstack(cards)
    rows = round(BAND / HEIGHT * len(image))
    # Dark and blank tiles in turn, each as wide as chance has it.
    ends = np.cumsum(appearance_rng.integers(36, 66, 40))
    for left, right in zip(ends[::2], ends[1::2], strict=True):
        image[-rows:, left:right] = appearance_rng.uniform(0, 60, 3)
        image[-rows:, right : right + 66] = glaze
    body = add_mocap_body(spec, OBJECT)
    wall = add_material(spec, "cup", image, shine=0.3)
    plain = tuple(glaze / 255)
    add_band(spec, body, "outside", ((RADIUS, 0.0), (TOP_RADIUS, HEIGHT)), wall)
    add_band(spec, body, "rim", ((TOP_RADIUS, HEIGHT), (TOP_RADIUS - WALL, HEIGHT)), color=plain)
    add_band(spec, body, "inside", ((TOP_RADIUS - WALL, HEIGHT), (TOP_RADIUS, DRINK)), color=plain)
    add_cylinder(body, (0, 0, 0.002), (0, 0, DRINK), TOP_RADIUS - WALL / 2, color=(0.16, 0.09, 0.05))
    add_cylinder(body, (0, 0, 0), (0, 0, 0.002), RADIUS - WALL, color=plain)  # the base, on which it stands
