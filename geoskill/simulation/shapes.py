"""Building blocks of scenes: materials and simple shapes in a MuJoCo specification.

Nothing that is added here collides; bodies are moved along scripted paths. Sizes are in meters, poses are relative to
the parent body, RGB colors are from 0 to 1.
"""

import math
from collections.abc import Sequence

import mujoco
import numpy as np
from jaxtyping import UInt8

from geoskill.geometry.poses import Pose, pose, quaternion

Color = Sequence[float]  # red, green, blue

HALF_PLATE_THICKNESS = 0.0004
BAND_FACETS = 48


def add_material(
    spec: mujoco.MjSpec,
    name: str,
    image: UInt8[np.ndarray, "height width 3"],
    repeat: tuple[float, float] = (1.0, 1.0),
    *,
    per_meter: bool = False,
    shine: float = 0.1,
) -> str:
    """Add a material with a texture and return its name.

    Args:
        spec: the scene.
        name: of the material.
        image: the texture, RGB.
        repeat: number of repetitions of the image along x and y; by default one image covers the surface.
        per_meter: whether ``repeat`` counts repetitions per meter instead of per surface.
        shine: specular reflection of the material, from 0 to 1.
    """
    height, width = image.shape[:2]
    texture = spec.add_texture(name=name, type=mujoco.mjtTexture.mjTEXTURE_2D, width=width, height=height, nchannel=3)
    texture.data = np.ascontiguousarray(image).tobytes()
    material = spec.add_material(
        name=name, texrepeat=list(repeat), texuniform=per_meter, specular=shine, shininess=0.3, rgba=[1, 1, 1, 1]
    )
    material.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = name
    return name


def add_mocap_body(spec: mujoco.MjSpec, name: str, body_pose: Pose | None = None) -> mujoco.MjsBody:
    """Add a body whose pose is set on every frame (a MuJoCo mocap body); without a pose it is at the origin."""
    body_pose = np.eye(4) if body_pose is None else body_pose
    return spec.worldbody.add_body(name=name, mocap=True, pos=body_pose[:3, 3], quat=quaternion(body_pose[:3, :3]))


def set_body_pose(model: mujoco.MjModel, data: mujoco.MjData, body: str, body_pose: Pose) -> None:
    """Set the world pose of a body that :func:`add_mocap_body` added."""
    mocap_id = model.body(body).mocapid[0]
    data.mocap_pos[mocap_id] = body_pose[:3, 3]
    data.mocap_quat[mocap_id] = quaternion(body_pose[:3, :3])


def add_box(
    body: mujoco.MjsBody, half_size: Sequence[float], box_pose: Pose, material: str = "", color: Color = (1, 1, 1)
) -> None:
    """Add a box with the given half sizes along x, y and z."""
    geometry = {"size": half_size, "pos": box_pose[:3, 3], "quat": quaternion(box_pose[:3, :3])}
    _add(body, mujoco.mjtGeom.mjGEOM_BOX, material, color, **geometry)


def add_capsule(
    body: mujoco.MjsBody,
    start: Sequence[float],
    end: Sequence[float],
    radius: float,
    material: str = "",
    color: Color = (1, 1, 1),
) -> None:
    """Add a cylinder with round ends whose axis joins two points."""
    _add(body, mujoco.mjtGeom.mjGEOM_CAPSULE, material, color, size=[radius, 0, 0], fromto=[*start, *end])


def add_cylinder(
    body: mujoco.MjsBody,
    start: Sequence[float],
    end: Sequence[float],
    radius: float,
    material: str = "",
    color: Color = (1, 1, 1),
) -> None:
    """Add a cylinder with flat ends whose axis joins two points."""
    _add(body, mujoco.mjtGeom.mjGEOM_CYLINDER, material, color, size=[radius, 0, 0], fromto=[*start, *end])


def add_printed_box(
    body: mujoco.MjsBody, half_size: Sequence[float], face_materials: dict[str, str], color: Color, box_pose: Pose
) -> None:
    """Add a box with images on some of its faces.

    MuJoCo maps a box's texture by x and y only, so every image is on a thin plate of its own.

    Args:
        body: to which the box is added.
        half_size: half sizes along x, y and z.
        face_materials: materials by face: ``+z`` (the top), ``+x``, ``-x``, ``+y``, ``-y``.
        color: of the remaining faces.
        box_pose: pose in the body.
    """
    add_box(body, half_size, box_pose, color=color)
    x, y, z = half_size
    along_x, along_y, up = np.eye(3)
    # Axes of the plate, its half sizes, and its distance from the box's center.
    layouts = {
        "+z": ((along_x, along_y, up), (x, y), z),
        "-y": ((along_x, up, -along_y), (x, z), y),
        "+y": ((-along_x, up, along_y), (x, z), y),
        "+x": ((along_y, up, along_x), (y, z), x),
        "-x": ((-along_y, up, -along_x), (y, z), x),
    }
    for face, material in face_materials.items():
        axes, (half_width, half_height), distance = layouts[face]
        rotation = np.column_stack(axes)
        plate_pose = box_pose @ pose(axes[2] * distance, rotation)
        add_box(body, (half_width, half_height, HALF_PLATE_THICKNESS), plate_pose, material)


def add_band(
    spec: mujoco.MjSpec,
    body: mujoco.MjsBody,
    name: str,
    profile: tuple[tuple[float, float], tuple[float, float]],
    material: str = "",
    color: Color = (1, 1, 1),
) -> None:
    """Add a surface of revolution about the body's z axis, such as the wall of a cup; it has no thickness.

    Args:
        spec: the scene.
        body: to which it is added.
        name: of the mesh.
        profile: radius and height of its two edges. From the first to the second, its visible side is to the right of
            the profile: outside for one that goes up.
        material: whose image goes around once, counterclockwise from above from the back (+y), with its upper border
            at the second edge.
        color: without a material.
    """
    angles = math.pi / 2 + np.linspace(0, 2 * math.pi, BAND_FACETS + 1)
    around = np.column_stack([np.cos(angles), np.sin(angles), np.zeros_like(angles)])
    (first_radius, first_z), (second_radius, second_z) = profile
    along = np.array([second_radius - first_radius, second_z - first_z]) / math.dist(*profile)
    edges = [around * radius + [0, 0, z] for radius, z in profile]
    normals = around * along[1] - [0, 0, along[0]]
    columns, last = np.arange(BAND_FACETS), BAND_FACETS + 1
    lower = np.column_stack([columns, columns + 1, columns + 1 + last])
    upper = np.column_stack([columns, columns + 1 + last, columns + last])
    shares = np.linspace(0, 1, last)
    coordinates = np.concatenate([np.column_stack([shares, np.full(last, v)]) for v in (1.0, 0.0)])
    spec.add_mesh(
        name=name,
        uservert=np.concatenate(edges).ravel().tolist(),
        usernormal=np.tile(normals, (2, 1)).ravel().tolist(),
        usertexcoord=coordinates.ravel().tolist(),
        userface=np.concatenate([lower, upper]).ravel().tolist(),
        inertia=mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL,
    )
    _add(body, mujoco.mjtGeom.mjGEOM_MESH, material, color, meshname=name, mass=0.0)


def _add(body: mujoco.MjsBody, shape: mujoco.mjtGeom, material: str, color: Color, **geometry: object) -> None:
    rgba = [1, 1, 1, 1] if material else [*color, 1.0]
    body.add_geom(type=shape, material=material, rgba=rgba, contype=0, conaffinity=0, **geometry)
