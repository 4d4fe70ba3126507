"""Screw: the tip of a screwdriver goes into the marked hole of a plate; both have little texture, as in the paper."""

import math
from typing import ClassVar, final

import cv2
import mujoco
import numpy as np
from jaxtyping import UInt8

from geoskill.geometry.poses import Pose, pose, rotation_about, table_pose
from geoskill.simulation.actors.actor import Grip
from geoskill.simulation.roles import SceneRole
from geoskill.simulation.shapes import add_box, add_cylinder, add_material, add_mocap_body, add_printed_box
from geoskill.simulation.tasks.task import PlanarPose, RigidObject, RolePart, Task, TaskScene
from geoskill.simulation.textures import metal

Picture = UInt8[np.ndarray, "height width 3"]

# The tool's frame is at its tip, with the z axis up along the shaft. Ends of its segments along z:
TIP, SHAFT, HANDLE, LENGTH = 0.012, 0.090, 0.098, 0.192
HANDLE_RADIUS = 0.015
HALF_PLATE = (0.072, 0.052, 0.005)
HOLE_RADIUS = 0.0045
DEPTH = 0.007  # of the tip in the hole
COLUMNS, ROWS = 3, 2
PITCH = 0.040
ENGRAVED = (70.0, 70.0, 75.0)
OBJECT, TARGET = "screwdriver", "plate"


@final
class Screw(Task):
    """A task with a plate of six holes, of which a ring of paint marks one; the whole plate is the target."""

    name: ClassVar[str] = "screw"

    def build(
        self,
        spec: mujoco.MjSpec,
        target: PlanarPose,
        start: PlanarPose,
        appearance_rng: np.random.Generator,
        episode_rng: np.random.Generator,
    ) -> TaskScene:
        """See :meth:`Task.build`."""
        plate = table_pose(-0.085 + target.x, -0.01 + target.y, target.yaw_rad)
        marked = int(appearance_rng.integers(COLUMNS * ROWS))
        _add_plate(spec, plate, marked, appearance_rng)
        _add_screwdriver(spec, appearance_rng)
        _add_distractors(spec, appearance_rng)
        # The tool leans mostly to the right, since the camera hardly sees a lean toward it or away from it.
        lean = rotation_about(np.array([episode_rng.uniform(-0.15, 0.1), episode_rng.uniform(0.25, 0.55), 0.0]))
        goal = plate @ pose((*_hole(marked), 2 * HALF_PLATE[2] - DEPTH))
        sides = [(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]
        corners = np.array(sides) * HALF_PLATE + np.array([0.0, 0.0, HALF_PLATE[2]])
        grip_pose = pose(
            (0.0, episode_rng.uniform(-0.002, 0.003), episode_rng.uniform(0.134, 0.146)),
            rotation_about(np.array([episode_rng.uniform(0.0, 0.15), 0.0, episode_rng.uniform(-0.25, 0.15)])),
        )
        return TaskScene(
            start=table_pose(0.145 + start.x, -0.07 + start.y, start.yaw_rad, 0.002) @ pose((0.0, 0.0, 0.0), lean),
            goal=goal,
            approach=np.array([0.0, 0.0, 0.05]),
            height=0.04,
            grip=Grip(grip_pose, HANDLE_RADIUS),
            dynamics=RigidObject(OBJECT),
            extent=corners - np.array([*_hole(marked), 2 * HALF_PLATE[2] - DEPTH]),
            roles=(RolePart(OBJECT, SceneRole.OBJECT), RolePart(TARGET, SceneRole.TARGET)),
            solid=False,  # the holes are paint
        )


def _hole(index: int) -> tuple[float, float]:
    """Return the x and y of a hole in the plate's frame."""
    row, column = divmod(index, COLUMNS)
    return (column - (COLUMNS - 1) / 2) * PITCH, (row - (ROWS - 1) / 2) * PITCH


def _add_plate(spec: mujoco.MjSpec, plate: Pose, marked: int, appearance_rng: np.random.Generator) -> None:
    sheet = metal(appearance_rng, tuple(appearance_rng.uniform(130, 165) + appearance_rng.normal(0, 4, 3)))
    scale = len(sheet) / (2 * HALF_PLATE[0])
    image = np.ascontiguousarray(sheet[: round(2 * HALF_PLATE[1] * scale)])
    paint = tuple(map(float, appearance_rng.uniform(20, 190, 3)))

    def to_pixel(x: float, y: float) -> tuple[int, int]:
        return round((x + HALF_PLATE[0]) * scale), round((HALF_PLATE[1] - y) * scale)

    for index in range(COLUMNS * ROWS):
        x, y = _hole(index)
        if index == marked:
            cv2.circle(image, to_pixel(x, y), round(0.0095 * scale), paint, round(0.003 * scale), cv2.LINE_AA)
        radius = HOLE_RADIUS * scale
        cv2.circle(image, to_pixel(x, y), round(radius * 1.3), (200.0, 200.0, 200.0), -1, cv2.LINE_AA)
        cv2.circle(image, to_pixel(x, y), round(radius), (25.0, 25.0, 28.0), -1, cv2.LINE_AA)
        _engrave(image, str(index + 1), to_pixel(x + 0.011, y + 0.008))
    _engrave(image, f"M{appearance_rng.integers(3, 9)}-{appearance_rng.integers(100, 999)}", to_pixel(-0.066, 0.040))
    for _ in range(3):
        ends = appearance_rng.uniform(-0.9, 0.9, (2, 2)) * HALF_PLATE[:2]
        cv2.line(image, to_pixel(*ends[0]), to_pixel(*ends[1]), (125.0, 125.0, 128.0), 1, cv2.LINE_AA)
    body = add_mocap_body(spec, TARGET, plate)
    faces = {"+z": add_material(spec, "plate", image, shine=0.25)}
    add_printed_box(body, HALF_PLATE, faces, (0.45, 0.45, 0.46), pose((0, 0, HALF_PLATE[2])))


def _add_screwdriver(spec: mujoco.MjSpec, appearance_rng: np.random.Generator) -> None:
    """Add the screwdriver: a shaft, and an octagonal handle with a label on its front side."""
    body = add_mocap_body(spec, OBJECT)
    steel = add_material(spec, "steel", metal(appearance_rng, (150, 150, 155)), (60, 60), per_meter=True, shine=0.5)
    plastic, gray, yellow = tuple(appearance_rng.uniform(0.08, 0.6, 3)), (0.16, 0.16, 0.17), (0.80, 0.72, 0.20)
    add_cylinder(body, (0, 0, 0), (0, 0, TIP), 0.0034, color=gray)
    add_cylinder(body, (0, 0, TIP), (0, 0, SHAFT), 0.0045, steel)
    add_cylinder(body, (0, 0, 0.045), (0, 0, 0.052), 0.0049, color=yellow)
    add_cylinder(body, (0, 0, SHAFT), (0, 0, HANDLE), 0.0095, color=gray)
    center, half_length = (HANDLE + LENGTH) / 2, (LENGTH - HANDLE) / 2
    half_side = HANDLE_RADIUS * math.tan(math.pi / 8)
    for number in range(4):
        turn = rotation_about(np.array([0.0, 0.0, number * math.pi / 4]))
        add_box(body, (HANDLE_RADIUS, half_side, half_length), pose((0, 0, center), turn), color=plastic)
    add_cylinder(body, (0, 0, HANDLE + 0.006), (0, 0, HANDLE + 0.012), HANDLE_RADIUS * 1.09, color=yellow)
    add_cylinder(body, (0, 0, LENGTH), (0, 0, LENGTH + 0.004), HANDLE_RADIUS * 0.8, color=yellow)
    label = _label(appearance_rng)
    half_label = (half_side * 0.9, 0.022)
    upright = np.column_stack([(1.0, 0.0, 0.0), (0.0, 0.0, 1.0), (0.0, -1.0, 0.0)])
    label_pose = pose((0.0, -HANDLE_RADIUS, center - 0.008), upright)
    add_box(body, (*half_label, 0.0003), label_pose, add_material(spec, "label", label))


def _label(appearance_rng: np.random.Generator) -> Picture:
    """Return the print of a sticker: three letters, one above the other, and a bar."""
    image = np.full((350, 96, 3), (225, 222, 210), np.uint8)
    for row in range(3):
        letter = "AEHKPRTX"[appearance_rng.integers(8)]
        position = (16, 100 + 85 * row)
        cv2.putText(image, letter, position, cv2.FONT_HERSHEY_DUPLEX, 3.0, (30.0, 30.0, 40.0), 9, cv2.LINE_AA)
    cv2.rectangle(image, (0, 290), (96, 330), tuple(map(float, appearance_rng.uniform(20, 160, 3))), -1)
    return image


def _engrave(image: Picture, text: str, position: tuple[int, int]) -> None:
    cv2.putText(image, text, position, cv2.FONT_HERSHEY_SIMPLEX, 0.9, ENGRAVED, 3, cv2.LINE_AA)


def _add_distractors(spec: mujoco.MjSpec, appearance_rng: np.random.Generator) -> None:
    """Add screws and a box, away from the path and from all placements of the target."""
    steel = (0.55, 0.55, 0.57)
    for number, (x, y) in enumerate(((0.02, -0.185), (0.055, -0.165), (-0.25, 0.15))):
        turn = appearance_rng.uniform(-math.pi, math.pi)
        body = add_mocap_body(spec, f"distractor_screw_{number}", table_pose(x, y, turn, 0.005))
        add_cylinder(body, (0, 0, 0), (0.026, 0, -0.0025), 0.0025, color=steel)
        add_cylinder(body, (-0.003, 0, 0), (0, 0, 0), 0.005, color=(0.35, 0.35, 0.36))
    box = add_mocap_body(spec, "distractor_box", table_pose(-0.225, -0.180, 0.4))
    lid = add_material(spec, "box", metal(appearance_rng, tuple(appearance_rng.uniform(60, 150, 3)))[:384])
    add_printed_box(
        box, (0.030, 0.022, 0.012), {"+z": lid}, tuple(appearance_rng.uniform(0.2, 0.5, 3)), pose((0, 0, 0.012))
    )
