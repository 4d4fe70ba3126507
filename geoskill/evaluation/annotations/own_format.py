"""Regions files in the format of this project.

The file is JSON::

    {"sequence": "Blocks/human1", "image_size": [240, 240],
     "frames": {"0": {"object": [[x, y], ...], "target": [...], "hand": [...]}, "5": {...}}}

Keys of ``frames`` are 0-based frame numbers of the sequence, vertices are pixels of the native image (x right, y down),
and ``[]`` is a region that is out of view. ``hand`` is the agent, a hand or a gripper. ``sequence`` is for the reader
only.
"""

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from geoskill.errors import InputError
from geoskill.evaluation.regions import ROLES, FrameRegions, Polygon, Regions, polygon_of
from geoskill.io.text_file import is_coordinate, written


def own_regions(path: str | Path, content: Mapping[str, Any], frame_count: int | None) -> Regions:
    """Return the regions of a file.

    Args:
        path: for messages.
        content: of the file.
        frame_count: number of frames of the video; None when it is not known.

    Raises:
        InputError: when the content does not have the format above, or names a frame that the video lacks.
    """
    for key in ("image_size", "frames"):
        if key not in content:
            raise InputError(f"{path}: {key!r} is missing; expected the keys image_size and frames")
    frames = content["frames"]
    if not isinstance(frames, dict):
        raise InputError(f"{path}: frames is {written(frames)}; expected an object with one entry per labeled frame")
    if not frames:
        raise InputError(f"{path}: frames is empty; expected at least one labeled frame")
    labeled = {_frame_number(path, key, frame_count): _parsed_frame(path, key, frames[key]) for key in frames}
    return Regions(str(path), _parsed_size(path, content["image_size"]), labeled)


def _parsed_size(path: str | Path, value: Any) -> tuple[int, int]:
    integers = isinstance(value, list) and all(isinstance(side, int) and not isinstance(side, bool) for side in value)
    if not (integers and len(value) == 2 and min(value) > 0):
        raise InputError(f"{path}: image_size is {written(value)}; expected [width, height] in pixels")
    return value[0], value[1]


def _frame_number(path: str | Path, key: str, frame_count: int | None) -> int:
    if not re.fullmatch(r"0|[1-9][0-9]{0,8}", key):
        raise InputError(f"{path}: frame {written(key)}; expected the frame's position, a whole number from 0 on")
    if frame_count is not None and int(key) >= frame_count:
        raise InputError(
            f"{path}: frame {key} is beyond the video, which has {frame_count} frames; expected numbers from 0 to "
            f"{frame_count - 1}"
        )
    return int(key)


def _parsed_frame(path: str | Path, key: str, value: Any) -> FrameRegions:
    names = ", ".join(ROLES)
    if not isinstance(value, dict):
        raise InputError(f"{path}: frame {key} is {written(value)}; expected an object with the regions {names}")
    for name in value:
        if name not in ROLES:
            raise InputError(f"{path}: frame {key} has the unknown region {written(name)}; expected {names}")
    for name in ROLES:
        if name not in value:
            raise InputError(f"{path}: frame {key} has no region '{name}'; expected its polygon, or [] out of view")
    return FrameRegions({role: _parsed_polygon(path, key, name, value[name]) for name, role in ROLES.items()})


def _parsed_polygon(path: str | Path, key: str, name: str, vertices: Any) -> Polygon:
    location = f"{path}: frame {key}, region '{name}'"
    if not isinstance(vertices, list):
        raise InputError(f"{location} is {written(vertices)}; expected a list of vertices [x, y]")
    if 0 < len(vertices) < 3:
        raise InputError(f"{location} has {len(vertices)} vertices; expected at least 3, or [] where it is out of view")
    for number, vertex in enumerate(vertices):
        if not (isinstance(vertex, list) and len(vertex) == 2 and all(map(is_coordinate, vertex))):
            raise InputError(f"{location}, vertex {number} is {written(vertex)}; expected [x, y] in pixels")
    return polygon_of(vertices)
