"""A recorded scene: frames as a camera delivers them, with the ground truth that the renderer knows."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import final

import cv2
import numpy as np
from jaxtyping import Float32, Float64, Int, Int16, UInt8

from geoskill.geometry.camera import PinholeCamera
from geoskill.simulation.roles import SceneRole
from geoskill.simulation.tasks.task import RolePart

FRAME_RATE = 30.0
DEPTH_UNIT_M = 1e-4


@final
@dataclass(frozen=True, eq=False)
class Cloth:
    """The cloth of a scene, as a triangle mesh.

    Attributes:
        name: by which roles refer to it.
        rest: positions of its vertices in its own frame, in which it lies flat, meters.
        triangles: indices of vertices.
        vertices: positions of its vertices in the world, frame by frame, meters.
    """

    name: str
    rest: Float64[np.ndarray, "v 3"]
    triangles: Int[np.ndarray, "t 3"]
    vertices: Float64[np.ndarray, "frames v 3"]


@final
@dataclass(frozen=True, eq=False)
class Recording:
    """Frames with their ground truth.

    Attributes:
        pictures: JPEG files.
        segmentations: PNG files with the id of the body that is visible at each pixel plus 2: 1 the cloth, 0 none.
        depths: PNG files with the depth of each pixel in units of :data:`DEPTH_UNIT_M`.
        bodies: names of the bodies, by id.
        poses: world poses of all bodies, frame by frame.
        intrinsics: the camera at the origin.
        camera_poses: world poses of the camera, frame by frame.
        roles: the parts of bodies that are the object, the target or the agent; the first that contains a point counts.
        cloth: the cloth, if there is one.
    """

    pictures: Sequence[bytes]
    segmentations: Sequence[bytes]
    depths: Sequence[bytes]
    bodies: Sequence[str]
    poses: Float64[np.ndarray, "frames bodies 4 4"]
    intrinsics: PinholeCamera
    camera_poses: Float64[np.ndarray, "frames 4 4"]
    roles: tuple[RolePart, ...]
    cloth: Cloth | None = None

    def __len__(self) -> int:
        return len(self.pictures)

    def picture(self, frame: int) -> UInt8[np.ndarray, "height width 3"]:
        """Return the RGB image of a frame."""
        return decode_picture(self.pictures[frame])

    def body_ids(self, frame: int) -> Int16[np.ndarray, "height width"]:
        """Return the id of the body that is visible at each pixel: -1 for the cloth, -2 for none."""
        return _decode_png(self.segmentations[frame]).astype(np.int16) - np.int16(2)

    def depth_m(self, frame: int) -> Float32[np.ndarray, "height width"]:
        """Return the depth of each pixel along the camera's axis, meters."""
        return _decode_png(self.depths[frame]).astype(np.float32) * np.float32(DEPTH_UNIT_M)

    def view(self, frame: int) -> PinholeCamera:
        """Return the camera at its pose of a frame."""
        intrinsics = self.intrinsics
        return PinholeCamera(intrinsics.width, intrinsics.height, intrinsics.focal_px, self.camera_poses[frame])


def join(recordings: Sequence[Recording]) -> Recording:
    """Return one recording with the frames of several of one scene, in their order.

    Raises:
        ValueError: when there is none, or their bodies differ.
    """
    if not recordings or any(recording.bodies != recordings[0].bodies for recording in recordings):
        raise ValueError(f"{len(recordings)} recordings: expected one or more of the same bodies")
    cloths = [recording.cloth for recording in recordings if recording.cloth is not None]
    vertices = [cloth.vertices for cloth in cloths]
    return replace(
        recordings[0],
        pictures=[file for recording in recordings for file in recording.pictures],
        segmentations=[file for recording in recordings for file in recording.segmentations],
        depths=[file for recording in recordings for file in recording.depths],
        poses=np.concatenate([recording.poses for recording in recordings]),
        camera_poses=np.concatenate([recording.camera_poses for recording in recordings]),
        cloth=replace(cloths[0], vertices=np.concatenate(vertices)) if cloths else None,
    )


def decode_picture(data: bytes) -> UInt8[np.ndarray, "height width 3"]:
    """Return the RGB image of a JPEG file."""
    image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)
    return np.ascontiguousarray(np.asarray(image, np.uint8)[..., ::-1])


def encode_png(image: np.ndarray) -> bytes:
    """Encode an image of one channel with 8 or 16 bits, without loss."""
    ok, data = cv2.imencode(".png", image, [cv2.IMWRITE_PNG_COMPRESSION, 2])
    assert ok
    return data.tobytes()


def _decode_png(data: bytes) -> np.ndarray:
    image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    return np.asarray(image)


def pack(recording: Recording) -> dict[str, np.ndarray]:
    """Return a recording as plain arrays, to be stored."""
    arrays = {
        "bodies": np.array(recording.bodies),
        "poses": recording.poses,
        "size": np.array([recording.intrinsics.width, recording.intrinsics.height]),
        "focal_px": np.array(recording.intrinsics.focal_px),
        "camera": recording.camera_poses,
        "role_bodies": np.array([part.body for part in recording.roles]),
        "roles": np.array([str(part.role) for part in recording.roles]),
        "role_bounds": np.array([[part.lower, part.upper] for part in recording.roles]),
    }
    files_by_key = {"pictures": recording.pictures, "shown": recording.segmentations, "depths": recording.depths}
    for key, files in files_by_key.items():
        arrays[key] = np.frombuffer(b"".join(files), np.uint8)
        arrays[f"{key}_ends"] = np.cumsum([len(file) for file in files])
    if recording.cloth is not None:
        arrays |= {
            "cloth": np.array(recording.cloth.name),
            "cloth_rest": recording.cloth.rest,
            "cloth_triangles": recording.cloth.triangles,
            "cloth_vertices": recording.cloth.vertices,
        }
    return arrays


def unpack(arrays: Mapping[str, np.ndarray]) -> Recording:
    """Return the recording of arrays from :func:`pack`.

    Raises:
        KeyError: when an array is missing.
        ValueError: when a role is unknown.
    """
    pictures, segmentations, depths = (
        [file.tobytes() for file in np.split(arrays[key], arrays[f"{key}_ends"][:-1])]
        for key in ("pictures", "shown", "depths")
    )
    roles = tuple(
        RolePart(str(body), SceneRole(role), tuple(lower), tuple(upper))
        for body, role, (lower, upper) in zip(
            arrays["role_bodies"], arrays["roles"], arrays["role_bounds"].tolist(), strict=True
        )
    )
    width, height = arrays["size"].tolist()
    cloth = None
    if "cloth" in arrays:
        cloth_arrays = (arrays[f"cloth_{name}"] for name in ("rest", "triangles", "vertices"))
        cloth = Cloth(str(arrays["cloth"]), *cloth_arrays)
    return Recording(
        pictures=pictures,
        segmentations=segmentations,
        depths=depths,
        bodies=arrays["bodies"].tolist(),
        poses=arrays["poses"],
        intrinsics=PinholeCamera(width, height, float(arrays["focal_px"]), np.eye(4)),
        camera_poses=arrays["camera"],
        roles=roles,
        cloth=cloth,
    )
