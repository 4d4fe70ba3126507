"""Ground truth of real frames: hand-labeled polygons of the object, the target and the hand.

The file is JSON::

    {"sequence": "Blocks/human1", "image_size": [240, 240],
     "frames": {"0": {"object": [[x, y], ...], "target": [...], "hand": [...]}, "5": {...}}}

Keys of ``frames`` are 0-based frame numbers of the sequence, vertices are pixels of the native image (x right, y down),
and ``[]`` is a region that is out of view. ``hand`` is the agent, a hand or a gripper. ``sequence`` is for the reader
only.
"""

import json
import math
import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, final

import cv2
import numpy as np
from jaxtyping import Float32

from geoskill.errors import InputError, shown
from geoskill.evaluation.labels import TOLERANCE_PX, FrameLabels, Labels
from geoskill.simulation.roles import SceneRole

# JSON unfolds to some twenty times its size; a thousand labeled frames take one megabyte.
MAX_BYTES = 20_000_000
Polygon = Float32[np.ndarray, "_ 2"]

# Keys of the regions in the file.
_ROLES = {"object": SceneRole.OBJECT, "target": SceneRole.TARGET, "hand": SceneRole.AGENT}


@final
@dataclass(frozen=True, eq=False)
class FrameRegions(FrameLabels):
    """Polygons of one frame.

    Attributes:
        polygons: ``[v, 2]`` in pixels for each role; without vertices where the region is out of view.
    """

    polygons: Mapping[SceneRole, Polygon]

    def signed_distance(self, role: SceneRole, point: tuple[float, float]) -> float:
        """Return the distance in pixels to a region's outline: positive inside, 0 on it, ``-inf`` when out of view."""
        polygon = self.polygons[role]
        if len(polygon) == 0:
            return -math.inf
        return float(cv2.pointPolygonTest(polygon, (float(point[0]), float(point[1])), True))

    def contains(self, role: SceneRole, point: tuple[float, float], tolerance_px: float = TOLERANCE_PX) -> bool:
        """Return whether a point is in a region or within ``tolerance_px`` of it, whatever the other regions are."""
        return self.signed_distance(role, point) >= -tolerance_px

    def label(
        self,
        point: tuple[float, float],
        tolerance_px: float = TOLERANCE_PX,
        among: Sequence[SceneRole] = tuple(SceneRole),
    ) -> SceneRole | None:
        """See :meth:`FrameLabels.label`."""
        distances = {role: self.signed_distance(role, point) for role in among}
        for tolerance in (0.0, tolerance_px):
            for role, distance in distances.items():
                if distance >= -tolerance:
                    return role
        return None

    def at_goal(self, coordinates: Sequence[tuple[float, float]]) -> None:
        """Return None: polygons do not include the goal."""

    @property
    def goal_pixel_m(self) -> None:
        """None: polygons have no metric size."""


@final
@dataclass(frozen=True, eq=False)
class Regions(Labels):
    """Labeled frames of one sequence.

    Attributes:
        name: path of the file, for messages.
        image_size: width and height in pixels of the labeled images.
        labeled: polygons of each labeled frame by its number; at least one frame.
    """

    name: str
    image_size: tuple[int, int]
    labeled: Mapping[int, FrameRegions]

    @property
    def first_frame(self) -> int:
        """Smallest number of a labeled frame."""
        return min(self.labeled)

    @property
    def last_frame(self) -> int:
        """Largest number of a labeled frame."""
        return max(self.labeled)

    def at(self, frame: int) -> FrameRegions | None:
        """Interpolate the polygons of a frame; None before the first and after the last labeled frame.

        Between two labeled frames each vertex moves linearly. When their numbers of vertices differ, or the region is
        out of view on one of them, the polygon is that of the nearer labeled frame, and halfway that of the earlier
        one.
        """
        if not self.first_frame <= frame <= self.last_frame:
            return None
        before = max(number for number in self.labeled if number <= frame)
        after = min(number for number in self.labeled if number >= frame)
        fraction = (frame - before) / max(after - before, 1)
        earlier, later = self.labeled[before].polygons, self.labeled[after].polygons
        return FrameRegions({role: _interpolated(earlier[role], later[role], fraction) for role in SceneRole})

    def require_size(self, image_size: tuple[int, int]) -> None:
        """Raise InputError unless ``image_size``, width and height of the video in pixels, is that of the labels."""
        if image_size != self.image_size:
            raise InputError(
                f"{self.name}: image_size is {_size(self.image_size)}; expected {_size(image_size)}, the frame size of "
                "the video, since polygons are pixels of its native frames"
            )


def load_regions(
    path: str | Path, image_size: tuple[int, int] | None = None, frame_count: int | None = None
) -> Regions:
    """Read a regions file and check it against its video.

    Args:
        path: JSON file.
        image_size: width and height of the video's frames in pixels; None when they are not known yet.
        frame_count: number of frames of the video; None when it is not known.

    Raises:
        InputError: when there is no such file, it does not have the format above, or it does not fit the video.
    """
    content = _read_json(path)
    for key in ("image_size", "frames"):
        if key not in content:
            raise InputError(f"{path}: {key!r} is missing; expected the keys image_size and frames")
    frames = content["frames"]
    if not isinstance(frames, dict):
        raise InputError(f"{path}: frames is {_shown(frames)}; expected an object with one entry per labeled frame")
    if not frames:
        raise InputError(f"{path}: frames is empty; expected at least one labeled frame")
    labeled = {_frame_number(path, key, frame_count): _parsed_frame(path, key, frames[key]) for key in frames}
    regions = Regions(str(path), _parsed_size(path, content["image_size"]), labeled)
    if image_size is not None:
        regions.require_size(image_size)
    return regions


def _interpolated(earlier: Polygon, later: Polygon, fraction: float) -> Polygon:
    if len(earlier) != len(later):
        return earlier if fraction <= 0.5 else later
    return np.asarray((1.0 - fraction) * earlier + fraction * later, np.float32)


def _read_json(path: str | Path) -> dict[str, Any]:
    try:
        size = Path(path).stat().st_size
        if size > MAX_BYTES:
            raise InputError(f"{path}: is {size} bytes large; expected a regions file of at most {MAX_BYTES}")
        text = Path(path).read_text(encoding="utf-8-sig")  # without the mark with which some editors begin a file
    except FileNotFoundError:
        raise InputError(f"{path}: no such file; expected a regions file (JSON)") from None
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: cannot be read ({error}); expected a regions file (JSON)") from error
    try:
        content = json.loads(text, object_pairs_hook=_without_duplicates)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None
    except (ValueError, RecursionError) as error:
        raise InputError(f"{path}: not valid JSON ({error}); expected a regions file") from error
    if not isinstance(content, dict):
        raise InputError(f"{path}: holds {_shown(content)}; expected an object with the keys image_size and frames")
    return content


def _without_duplicates(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    # Python's reader silently keeps the last of two entries with the same key.
    content = dict(pairs)
    if len(content) < len(pairs):
        counts = Counter(key for key, _ in pairs)
        repeated = next(key for key, count in counts.items() if count > 1)
        raise InputError(f"the key {shown(repeated)} occurs more than once in one object; expected each once")
    return content


def _parsed_size(path: str | Path, value: Any) -> tuple[int, int]:
    integers = isinstance(value, list) and all(isinstance(side, int) and not isinstance(side, bool) for side in value)
    if not (integers and len(value) == 2 and min(value) > 0):
        raise InputError(f"{path}: image_size is {_shown(value)}; expected [width, height] in pixels")
    return value[0], value[1]


def _frame_number(path: str | Path, key: str, frame_count: int | None) -> int:
    if not re.fullmatch(r"0|[1-9][0-9]{0,8}", key):
        raise InputError(f"{path}: frame {_shown(key)}; expected the frame's position, a whole number from 0 on")
    if frame_count is not None and int(key) >= frame_count:
        raise InputError(
            f"{path}: frame {key} is beyond the video, which has {frame_count} frames; expected numbers from 0 to "
            f"{frame_count - 1}"
        )
    return int(key)


def _parsed_frame(path: str | Path, key: str, value: Any) -> FrameRegions:
    names = ", ".join(_ROLES)
    if not isinstance(value, dict):
        raise InputError(f"{path}: frame {key} is {_shown(value)}; expected an object with the regions {names}")
    for name in value:
        if name not in _ROLES:
            raise InputError(f"{path}: frame {key} has the unknown region {_shown(name)}; expected {names}")
    for name in _ROLES:
        if name not in value:
            raise InputError(f"{path}: frame {key} has no region '{name}'; expected its polygon, or [] out of view")
    return FrameRegions({role: _parsed_polygon(path, key, name, value[name]) for name, role in _ROLES.items()})


def _parsed_polygon(path: str | Path, key: str, name: str, vertices: Any) -> Polygon:
    location = f"{path}: frame {key}, region '{name}'"
    if not isinstance(vertices, list):
        raise InputError(f"{location} is {_shown(vertices)}; expected a list of vertices [x, y]")
    if 0 < len(vertices) < 3:
        raise InputError(f"{location} has {len(vertices)} vertices; expected at least 3, or [] where it is out of view")
    for number, vertex in enumerate(vertices):
        if not (isinstance(vertex, list) and len(vertex) == 2 and all(map(_is_coordinate, vertex))):
            raise InputError(f"{location}, vertex {number} is {_shown(vertex)}; expected [x, y] in pixels")
    return np.array(vertices, np.float32).reshape(-1, 2)


def _is_coordinate(value: Any) -> bool:
    # A polygon may reach beyond the image. The bound refuses NaN, infinity and numbers that overflow float32.
    return isinstance(value, int | float) and not isinstance(value, bool) and -1e6 <= value <= 1e6


def _shown(value: Any) -> str:
    text = json.dumps(value)
    return text if len(text) <= 60 else f"{text[:57]}..."


def _size(image_size: tuple[int, int]) -> str:
    return f"{image_size[0]}x{image_size[1]}"
