"""What scenes are made of: materials and simple shapes in a MuJoCo specification.

Nothing made here collides: things are led along their paths. Sizes are in meters, poses are those in the parent body.
"""

from collections.abc import Sequence

import mujoco
import numpy as np
from jaxtyping import UInt8

from geoskill.geometry.poses import Pose, pose, quaternion

Color = Sequence[float]  # red, green, blue


def textured(
    spec: mujoco.MjSpec,
    name: str,
    image: UInt8[np.ndarray, "height width 3"],
    repeat: tuple[float, float] = (1.0, 1.0),
    *,
    per_meter: bool = False,
    shine: float = 0.1,
) -> str:
    """A material with a picture; returns its name.

    Args:
        spec: the scene.
        name: of the material.
        image: RGB.
        repeat: how often the picture is repeated along x and y of the surface, which it covers once by default.
        per_meter: whether ``repeat`` is meant per meter, not per surface.
        shine: how much light the surface mirrors, from 0 to 1.
    """
    height, width = image.shape[:2]
    texture = spec.add_texture(name=name, type=mujoco.mjtTexture.mjTEXTURE_2D, width=width, height=height, nchannel=3)
    texture.data = np.ascontiguousarray(image).tobytes()
    material = spec.add_material(
        name=name, texrepeat=list(repeat), texuniform=per_meter, specular=shine, shininess=0.3, rgba=[1, 1, 1, 1]
    )
    material.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = name
    return name


def moving_body(spec: mujoco.MjSpec, name: str, matrix: Pose | None = None) -> mujoco.MjsBody:
    """A body that is put where it belongs on every frame."""
    matrix = np.eye(4) if matrix is None else matrix
    return spec.worldbody.add_body(name=name, mocap=True, pos=matrix[:3, 3], quat=quaternion(matrix[:3, :3]))


def place(model: mujoco.MjModel, data: mujoco.MjData, body: str, matrix: Pose) -> None:
    """Put a moving body where it belongs."""
    number = model.body(body).mocapid[0]
    data.mocap_pos[number] = matrix[:3, 3]
    data.mocap_quat[number] = quaternion(matrix[:3, :3])


def add_box(
    body: mujoco.MjsBody, half: Sequence[float], matrix: Pose, material: str = "", color: Color = (1, 1, 1)
) -> None:
    """A box with the given half sizes."""
    placing = {"size": half, "pos": matrix[:3, 3], "quat": quaternion(matrix[:3, :3])}
    _add(body, mujoco.mjtGeom.mjGEOM_BOX, material, color, **placing)


def add_capsule(
    body: mujoco.MjsBody,
    start: Sequence[float],
    end: Sequence[float],
    radius: float,
    material: str = "",
    color: Color = (1, 1, 1),
) -> None:
    """A cylinder with round ends, between two points."""
    _add(body, mujoco.mjtGeom.mjGEOM_CAPSULE, material, color, size=[radius, 0, 0], fromto=[*start, *end])


def add_cylinder(
    body: mujoco.MjsBody,
    start: Sequence[float],
    end: Sequence[float],
    radius: float,
    material: str = "",
    color: Color = (1, 1, 1),
) -> None:
    """A cylinder with flat ends, between two points."""
    _add(body, mujoco.mjtGeom.mjGEOM_CYLINDER, material, color, size=[radius, 0, 0], fromto=[*start, *end])


def add_printed_box(
    body: mujoco.MjsBody, half: Sequence[float], faces: dict[str, str], color: Color, matrix: Pose
) -> None:
    """A box with pictures on some of its faces.

    A texture of a MuJoCo box is spread over x and y only, so each picture is on a plate of its own.

    Args:
        body: what it becomes a part of.
        half: half sizes.
        faces: materials by face: ``+z`` the upper one, ``+x``, ``-x``, ``+y``, ``-y``.
        color: of the other faces.
        matrix: pose in the body.
    """
    add_box(body, half, matrix, color=color)
    x, y, z = half
    thin = 0.0004
    along_x, along_y, up = np.eye(3)
    # The plate's x, y and z axes, its half sizes, and how far out it lies.
    layouts = {
        "+z": ((along_x, along_y, up), (x, y), z),
        "-y": ((along_x, up, -along_y), (x, z), y),
        "+y": ((-along_x, up, along_y), (x, z), y),
        "+x": ((along_y, up, along_x), (y, z), x),
        "-x": ((-along_y, up, -along_x), (y, z), x),
    }
    for face, material in faces.items():
        axes, (wide, high), out = layouts[face]
        rotation = np.column_stack(axes)
        add_box(body, (wide, high, thin), matrix @ pose(axes[2] * out, rotation), material)


def _add(body: mujoco.MjsBody, kind: mujoco.mjtGeom, material: str, color: Color, **placing: object) -> None:
    rgba = [1, 1, 1, 1] if material else [*color, 1.0]
    body.add_geom(type=kind, material=material, rgba=rgba, contype=0, conaffinity=0, **placing)
