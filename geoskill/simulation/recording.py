"""A recorded scene: the frames as a camera delivers them, and beside each what the renderer knows."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import final

import cv2
import numpy as np
from jaxtyping import Float32, Float64, Int16, UInt8

from geoskill.geometry.camera import PinholeCamera
from geoskill.simulation.roles import SceneRole
from geoskill.simulation.tasks.task import RolePart

FRAME_RATE = 30.0
DEPTH_UNIT_M = 1e-4


@final
@dataclass(frozen=True, eq=False)
class Cloth:
    """The flexible part of a scene.

    Attributes:
        name: of the part, as roles name it.
        rest: where its vertices are in its own flat state, meters.
        triangles: numbers of vertices.
        vertices: where they are in the world, frame by frame.
    """

    name: str
    rest: Float64[np.ndarray, "v 3"]
    triangles: np.ndarray
    vertices: Float64[np.ndarray, "frames v 3"]


@final
@dataclass(frozen=True, eq=False)
class Recording:
    """Frames with their ground truth.

    Attributes:
        pictures: JPEG files.
        shown: PNG files of the number of the body that each pixel shows plus 2: 1 the cloth, 0 nothing.
        depths: PNG files of the depth of each pixel in :data:`DEPTH_UNIT_M`.
        bodies: names of the bodies by number.
        poses: of all bodies in the world, frame by frame.
        lens: the camera's intrinsics.
        camera: its poses in the world.
        roles: which parts of the bodies are the object, the target and the actor.
        cloth: the flexible part, if there is one.
    """

    pictures: Sequence[bytes]
    shown: Sequence[bytes]
    depths: Sequence[bytes]
    bodies: Sequence[str]
    poses: Float64[np.ndarray, "frames bodies 4 4"]
    lens: PinholeCamera
    camera: Float64[np.ndarray, "frames 4 4"]
    roles: tuple[RolePart, ...]
    cloth: Cloth | None = None

    def __len__(self) -> int:
        return len(self.pictures)

    def picture(self, frame: int) -> UInt8[np.ndarray, "height width 3"]:
        """RGB."""
        image = cv2.imdecode(np.frombuffer(self.pictures[frame], np.uint8), cv2.IMREAD_COLOR)
        return np.ascontiguousarray(np.asarray(image, np.uint8)[..., ::-1])

    def body_numbers(self, frame: int) -> Int16[np.ndarray, "height width"]:
        """The body that each pixel shows: -1 the cloth, -2 nothing."""
        return _from_png(self.shown[frame]).astype(np.int16) - np.int16(2)

    def depth_m(self, frame: int) -> Float32[np.ndarray, "height width"]:
        """The depth of each pixel, along the camera's axis."""
        return _from_png(self.depths[frame]).astype(np.float32) * np.float32(DEPTH_UNIT_M)

    def view(self, frame: int) -> PinholeCamera:
        """The camera on one frame."""
        return PinholeCamera(self.lens.width, self.lens.height, self.lens.focal_px, self.camera[frame])


def as_png(image: np.ndarray) -> bytes:
    """A picture of one channel, of 8 or 16 bits, without loss."""
    ok, data = cv2.imencode(".png", image, [cv2.IMWRITE_PNG_COMPRESSION, 2])
    assert ok
    return data.tobytes()


def _from_png(data: bytes) -> np.ndarray:
    image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    return np.asarray(image)


def pack(recording: Recording) -> dict[str, np.ndarray]:
    """The recording as plain arrays, to be stored."""
    arrays = {
        "bodies": np.array(recording.bodies),
        "poses": recording.poses,
        "size": np.array([recording.lens.width, recording.lens.height]),
        "focal_px": np.array(recording.lens.focal_px),
        "camera": recording.camera,
        "role_bodies": np.array([part.body for part in recording.roles]),
        "roles": np.array([str(part.role) for part in recording.roles]),
        "role_bounds": np.array([[part.lower, part.upper] for part in recording.roles]),
    }
    for name, files in (("pictures", recording.pictures), ("shown", recording.shown), ("depths", recording.depths)):
        arrays[name] = np.frombuffer(b"".join(files), np.uint8)
        arrays[f"{name}_ends"] = np.cumsum([len(file) for file in files])
    if recording.cloth is not None:
        arrays |= {
            "cloth": np.array(recording.cloth.name),
            "cloth_rest": recording.cloth.rest,
            "cloth_triangles": recording.cloth.triangles,
            "cloth_vertices": recording.cloth.vertices,
        }
    return arrays


def unpack(arrays: Mapping[str, np.ndarray]) -> Recording:
    """The inverse of :func:`pack`."""
    files = {
        name: [part.tobytes() for part in np.split(arrays[name], arrays[f"{name}_ends"][:-1])]
        for name in ("pictures", "shown", "depths")
    }
    roles = tuple(
        RolePart(str(body), SceneRole(role), tuple(lower), tuple(upper))
        for body, role, (lower, upper) in zip(
            arrays["role_bodies"], arrays["roles"], arrays["role_bounds"].tolist(), strict=True
        )
    )
    width, height = arrays["size"].tolist()
    cloth = None
    if "cloth" in arrays:
        parts = (arrays[f"cloth_{name}"] for name in ("rest", "triangles", "vertices"))
        cloth = Cloth(str(arrays["cloth"]), *parts)
    return Recording(
        **files,
        bodies=arrays["bodies"].tolist(),
        poses=arrays["poses"],
        lens=PinholeCamera(width, height, float(arrays["focal_px"]), np.eye(4)),
        camera=arrays["camera"],
        roles=roles,
        cloth=cloth,
    )
