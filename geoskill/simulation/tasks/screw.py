"""A screwdriver goes with its tip into the marked hole of a metal plate; all has little texture, as in the paper."""

import math
from typing import final

import cv2
import mujoco
import numpy as np
from jaxtyping import UInt8

from geoskill.geometry.poses import Pose, pose, rotation_about, table_pose
from geoskill.simulation.actors.actor import Grip
from geoskill.simulation.parts import add_box, add_cylinder, add_printed_box, moving_body, textured
from geoskill.simulation.roles import SceneRole
from geoskill.simulation.tasks.task import Rigid, RolePart, TablePlace, Task, TaskScene
from geoskill.simulation.textures import metal

Picture = UInt8[np.ndarray, "height width 3"]

# The tool's frame is at its tip, its z axis goes up along the shaft.
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
    """A plate with six holes, one marked by a ring of paint; the plate as a whole is the target."""

    @property
    def name(self) -> str:
        """See :attr:`Task.name`."""
        return "screw"

    def build(
        self,
        spec: mujoco.MjSpec,
        target: TablePlace,
        start: TablePlace,
        looks: np.random.Generator,
        take: np.random.Generator,
    ) -> TaskScene:
        """See :meth:`Task.build`."""
        plate = table_pose(-0.085 + target.x, -0.01 + target.y, target.yaw_rad)
        number = int(looks.integers(COLUMNS * ROWS))
        _add_plate(spec, plate, number, looks)
        _add_screwdriver(spec, looks)
        _add_distractors(spec, looks)
        # To the right, since the camera sees that better than a lean away from it or toward it.
        lean = rotation_about(np.array([take.uniform(-0.15, 0.1), take.uniform(0.25, 0.55), 0.0]))
        goal = plate @ pose((*_hole(number), 2 * HALF_PLATE[2] - DEPTH))
        sides = [(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]
        corners = np.array(sides) * HALF_PLATE + np.array([0.0, 0.0, HALF_PLATE[2]])
        held_at = pose(
            (0.0, take.uniform(-0.002, 0.003), take.uniform(0.134, 0.146)),
            rotation_about(np.array([take.uniform(0.0, 0.15), 0.0, take.uniform(-0.25, 0.15)])),
        )
        return TaskScene(
            start=table_pose(0.145 + start.x, -0.07 + start.y, start.yaw_rad, 0.002) @ pose((0.0, 0.0, 0.0), lean),
            goal=goal,
            approach=np.array([0.0, 0.0, 0.05]),
            height=0.04,
            grip=Grip(held_at, HANDLE_RADIUS),
            carrying=Rigid(OBJECT),
            extent=corners - np.array([*_hole(number), 2 * HALF_PLATE[2] - DEPTH]),
            roles=(RolePart(OBJECT, SceneRole.OBJECT), RolePart(TARGET, SceneRole.TARGET)),
        )


def _hole(number: int) -> tuple[float, float]:
    """Where a hole is on the plate."""
    row, column = divmod(number, COLUMNS)
    return (column - (COLUMNS - 1) / 2) * PITCH, (row - (ROWS - 1) / 2) * PITCH


def _add_plate(spec: mujoco.MjSpec, plate: Pose, marked: int, looks: np.random.Generator) -> None:
    sheet = metal(looks, tuple(looks.uniform(130, 165) + looks.normal(0, 4, 3)))
    scale = len(sheet) / (2 * HALF_PLATE[0])
    image = np.ascontiguousarray(sheet[: round(2 * HALF_PLATE[1] * scale)])
    paint = tuple(map(float, looks.uniform(20, 190, 3)))

    def place(x: float, y: float) -> tuple[int, int]:
        return round((x + HALF_PLATE[0]) * scale), round((HALF_PLATE[1] - y) * scale)

    for number in range(COLUMNS * ROWS):
        x, y = _hole(number)
        if number == marked:
            cv2.circle(image, place(x, y), round(0.0095 * scale), paint, round(0.003 * scale), cv2.LINE_AA)
        radius = HOLE_RADIUS * scale
        cv2.circle(image, place(x, y), round(radius * 1.3), (200.0, 200.0, 200.0), -1, cv2.LINE_AA)
        cv2.circle(image, place(x, y), round(radius), (25.0, 25.0, 28.0), -1, cv2.LINE_AA)
        _engrave(image, str(number + 1), place(x + 0.011, y + 0.008))
    _engrave(image, f"M{looks.integers(3, 9)}-{looks.integers(100, 999)}", place(-0.066, 0.040))
    for _ in range(3):
        ends = looks.uniform(-0.9, 0.9, (2, 2)) * HALF_PLATE[:2]
        cv2.line(image, place(*ends[0]), place(*ends[1]), (125.0, 125.0, 128.0), 1, cv2.LINE_AA)
    body = moving_body(spec, TARGET, plate)
    faces = {"+z": textured(spec, "plate", image, shine=0.25)}
    add_printed_box(body, HALF_PLATE, faces, (0.45, 0.45, 0.46), pose((0, 0, HALF_PLATE[2])))


def _add_screwdriver(spec: mujoco.MjSpec, looks: np.random.Generator) -> None:
    """A handle with eight sides, a label on the front one, and a shaft."""
    body = moving_body(spec, OBJECT)
    steel = textured(spec, "steel", metal(looks, (150, 150, 155)), (60, 60), per_meter=True, shine=0.5)
    plastic, gray, yellow = tuple(looks.uniform(0.08, 0.6, 3)), (0.16, 0.16, 0.17), (0.80, 0.72, 0.20)
    add_cylinder(body, (0, 0, 0), (0, 0, TIP), 0.0034, color=gray)
    add_cylinder(body, (0, 0, TIP), (0, 0, SHAFT), 0.0045, steel)
    add_cylinder(body, (0, 0, 0.045), (0, 0, 0.052), 0.0049, color=yellow)
    add_cylinder(body, (0, 0, SHAFT), (0, 0, HANDLE), 0.0095, color=gray)
    middle, half_length = (HANDLE + LENGTH) / 2, (LENGTH - HANDLE) / 2
    flat = HANDLE_RADIUS * math.tan(math.pi / 8)
    for number in range(4):
        turn = rotation_about(np.array([0.0, 0.0, number * math.pi / 4]))
        add_box(body, (HANDLE_RADIUS, flat, half_length), pose((0, 0, middle), turn), color=plastic)
    add_cylinder(body, (0, 0, HANDLE + 0.006), (0, 0, HANDLE + 0.012), HANDLE_RADIUS * 1.09, color=yellow)
    add_cylinder(body, (0, 0, LENGTH), (0, 0, LENGTH + 0.004), HANDLE_RADIUS * 0.8, color=yellow)
    label = _label(looks)
    half_label = (flat * 0.9, 0.022)
    upright = np.column_stack([(1.0, 0.0, 0.0), (0.0, 0.0, 1.0), (0.0, -1.0, 0.0)])
    where = pose((0.0, -HANDLE_RADIUS, middle - 0.008), upright)
    add_box(body, (*half_label, 0.0003), where, textured(spec, "label", label))


def _label(looks: np.random.Generator) -> Picture:
    """A sticker on the handle: a bar and a few letters, one above the other."""
    image = np.full((350, 96, 3), (225, 222, 210), np.uint8)
    for row in range(3):
        letter = "AEHKPRTX"[looks.integers(8)]
        where = (16, 100 + 85 * row)
        cv2.putText(image, letter, where, cv2.FONT_HERSHEY_DUPLEX, 3.0, (30.0, 30.0, 40.0), 9, cv2.LINE_AA)
    cv2.rectangle(image, (0, 290), (96, 330), tuple(map(float, looks.uniform(20, 160, 3))), -1)
    return image


def _engrave(image: Picture, text: str, where: tuple[int, int]) -> None:
    cv2.putText(image, text, where, cv2.FONT_HERSHEY_SIMPLEX, 0.9, ENGRAVED, 3, cv2.LINE_AA)


def _add_distractors(spec: mujoco.MjSpec, looks: np.random.Generator) -> None:
    """Screws and a box, where neither path nor target comes."""
    steel = (0.55, 0.55, 0.57)
    for number, (x, y) in enumerate(((0.02, -0.185), (0.055, -0.165), (-0.25, 0.15))):
        turn = looks.uniform(-math.pi, math.pi)
        body = moving_body(spec, f"distractor_screw_{number}", table_pose(x, y, turn, 0.005))
        add_cylinder(body, (0, 0, 0), (0.026, 0, -0.0025), 0.0025, color=steel)
        add_cylinder(body, (-0.003, 0, 0), (0, 0, 0), 0.005, color=(0.35, 0.35, 0.36))
    box = moving_body(spec, "distractor_box", table_pose(-0.225, -0.180, 0.4))
    lid = textured(spec, "box", metal(looks, tuple(looks.uniform(60, 150, 3)))[:384])
    add_printed_box(box, (0.030, 0.022, 0.012), {"+z": lid}, tuple(looks.uniform(0.2, 0.5, 3)), pose((0, 0, 0.012)))
