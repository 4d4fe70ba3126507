"""The file of a depth camera's intrinsics, ``camera.yaml``, as OpenCV, ROS and TUM write it, or as you do.

Intrinsics are a matrix of nine numbers or four numbers by name::

    camera_matrix: {rows: 3, cols: 3, data: [610, 0, 321.5, 0, 610, 238, 0, 0, 1]}     OpenCV, ROS calibration files
    K: [610, 0, 321.5, 0, 610, 238, 0, 0, 1]                                           ROS camera_info (k in ROS 2)
    {fx: 610, fy: 610, cx: 321.5, cy: 238}                                             TUM (also Camera.fx, ...)

Beside these may stand ``depth_factor`` (or TUM's ``DepthMapFactor``), the value of a pixel at one meter, 1000 if not
given; ``noise_per_m`` (:class:`DepthCamera`); and, where depth is not aligned with the pictures, ``depth`` with its own
intrinsics and ``depth_to_color``, a matrix of sixteen numbers that takes points of the depth camera to the color
camera's frame.
"""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, final

import numpy as np
import yaml
from jaxtyping import Float64

from geoskill.errors import InputError, shown
from geoskill.geometry.depth_camera import D435_NOISE_PER_M, DepthCamera

FILES: Final = ("camera.yaml", "camera.yml", "camera_info.yaml", "cam_K.txt")
"""Names that are looked for, in this order; the last is a plain matrix, as HRT1 has it."""
MAX_BYTES: Final = 1_000_000
MILLIMETERS: Final = 1000.0
_MATRICES: Final = ("camera_matrix", "Camera_Matrix", "cameraMatrix", "K", "k")
_FACTORS: Final = ("depth_factor", "DepthMapFactor", "Camera.DepthMapFactor", "factor")
EXPECTED: Final = "camera_matrix, K, or fx, fy, cx and cy, as OpenCV, ROS and TUM write them"


@final
@dataclass(frozen=True, eq=False)
class CameraFile:
    """What a file says of the cameras of pictures and depth.

    Attributes:
        color: intrinsics of the pictures.
        depth: intrinsics of the depth where it is not aligned with the pictures, else None.
        depth_to_color: takes points of the depth camera's frame to the color camera's.
        depth_factor: value of a pixel of depth at one meter.
    """

    color: DepthCamera
    depth: DepthCamera | None
    depth_to_color: Float64[np.ndarray, "4 4"]
    depth_factor: float


def find_camera_file(folder: Path) -> Path | None:
    """Return the file of intrinsics in a folder, or None."""
    return next((folder / name for name in FILES if (folder / name).is_file()), None)


def read_camera_file(path: Path) -> CameraFile:
    """Read a file of intrinsics.

    Raises:
        InputError: when it is no such file, or a number is missing or impossible.
    """
    entries = _entries(path)
    noise = _number(path, entries, ("noise_per_m",), D435_NOISE_PER_M)
    factor = _number(path, entries, _FACTORS, MILLIMETERS)
    if factor <= 0:
        raise InputError(f"{path}: depth_factor={factor:g}; expected the value of a pixel at one meter, such as 1000")
    color = _intrinsics(path, entries, noise)
    own, pose = entries.get("depth"), np.eye(4)
    if own is None:
        return CameraFile(color, None, pose, factor)
    if not isinstance(own, Mapping):
        raise InputError(f"{path}: depth is {shown(own)}; expected {EXPECTED}")
    if "depth_to_color" in entries:
        pose = np.array(_numbers(path, "depth_to_color", entries["depth_to_color"], 16)).reshape(4, 4)
        if not np.allclose(pose[:3, :3] @ pose[:3, :3].T, np.eye(3), atol=1e-2) or np.abs(pose[:3, 3]).max() > 1:
            raise InputError(f"{path}: depth_to_color is no rotation with a shift in meters; expected sixteen numbers")
    return CameraFile(color, _intrinsics(path, own, noise), pose, factor)


def _entries(path: Path) -> Mapping[str, Any]:
    try:
        if path.stat().st_size > MAX_BYTES:
            raise InputError(f"{path}: larger than {MAX_BYTES} bytes; expected {EXPECTED}")
        text = path.read_text(encoding="utf-8")
        if path.suffix == ".txt":
            return {"K": [float(word) for word in text.split()]}
        # OpenCV's own first line is no directive that YAML knows, and its matrices have a type.
        body = text.removeprefix("%YAML:1.0").replace("!!opencv-matrix", "")
        entries = yaml.safe_load(body)
    except (OSError, UnicodeDecodeError, ValueError, yaml.YAMLError, RecursionError) as error:
        if isinstance(error, InputError):
            raise
        message = " ".join(str(error).split())[:200]
        raise InputError(f"{path}: cannot be read ({message}); expected {EXPECTED}") from error
    if not isinstance(entries, Mapping):
        raise InputError(f"{path}: holds {shown(entries)}; expected {EXPECTED}")
    return entries


def _intrinsics(path: Path, entries: Mapping[str, Any], noise: float) -> DepthCamera:
    try:
        return DepthCamera(*_focal_and_center(path, entries), noise)
    except InputError:
        raise
    except ValueError as error:
        raise InputError(f"{path}: {error}") from error


def _focal_and_center(path: Path, entries: Mapping[str, Any]) -> tuple[float, float, float, float]:
    for key in _MATRICES:
        if key in entries:
            value = entries[key]
            matrix = _numbers(path, key, value.get("data") if isinstance(value, Mapping) else value, 9)
            return matrix[0], matrix[4], matrix[2], matrix[5]
    for prefix in ("", "Camera.", "Camera1."):
        keys = [prefix + name for name in ("fx", "fy", "cx", "cy")]
        if all(key in entries for key in keys):
            fx, fy, cx, cy = (_numbers(path, key, entries[key], 1)[0] for key in keys)
            return fx, fy, cx, cy
    raise InputError(f"{path}: has {', '.join(map(str, list(entries)[:8])) or 'nothing'}; expected {EXPECTED}")


def _number(path: Path, entries: Mapping[str, Any], keys: tuple[str, ...], default: float) -> float:
    key = next((key for key in keys if key in entries), None)
    return default if key is None else _numbers(path, key, entries[key], 1)[0]


def _numbers(path: Path, key: str, value: Any, count: int) -> list[float]:
    numbers = list(_flattened(value))
    if len(numbers) != count or not all(map(math.isfinite, numbers)):
        raise InputError(f"{path}: {key} is {shown(value)}; expected {count} number{'s' * (count > 1)}")
    return numbers


def _flattened(value: Any) -> Iterator[float]:
    """Yield the numbers of a list of lists; NaN for what is none."""
    if isinstance(value, list):
        for entry in value[:16]:
            yield from _flattened(entry)
    else:
        yield float(value) if isinstance(value, int | float) and not isinstance(value, bool) else math.nan
