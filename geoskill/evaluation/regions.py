"""The ground truth of real frames: hand-labeled polygons of the object, the target and the hand.

The file is JSON::

    {"sequence": "Blocks/human1", "image_size": [240, 240],
     "frames": {"0": {"object": [[x, y], ...], "target": [...], "hand": [...]}, "5": {...}}}

Keys of ``frames`` are 0-based positions in the sequence, vertices are pixels of the native image (x right, y down), and
``[]`` is a region that is out of view. ``sequence`` is for the reader only.
"""

import json
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, final

import cv2
import numpy as np
from jaxtyping import Float32

from geoskill.errors import InputError
from geoskill.evaluation.labels import TOLERANCE_PX, FrameLabels, Labels, Region

Polygon = Float32[np.ndarray, "_ 2"]


@final
@dataclass(frozen=True, eq=False)
class FrameRegions(FrameLabels):
    """The polygons of one frame, ``[v, 2]`` in pixels; one without vertices is out of view."""

    polygons: Mapping[Region, Polygon]

    def signed_distance(self, region: Region, point: tuple[float, float]) -> float:
        """Distance in pixels to the region's outline: positive inside, 0 on it, ``-inf`` when it is out of view."""
        polygon = self.polygons[region]
        if len(polygon) == 0:
            return -math.inf
        return float(cv2.pointPolygonTest(polygon, (float(point[0]), float(point[1])), True))

    def contains(self, region: Region, point: tuple[float, float], tolerance_px: float = TOLERANCE_PX) -> bool:
        """Whether a point lies in a region or no more than ``tolerance_px`` from it, whatever the other regions are."""
        return self.signed_distance(region, point) >= -tolerance_px

    def label(
        self, point: tuple[float, float], tolerance_px: float = TOLERANCE_PX, among: Sequence[Region] = tuple(Region)
    ) -> Region | None:
        """See :meth:`FrameLabels.label`."""
        distances = {region: self.signed_distance(region, point) for region in among}
        for reach in (0.0, tolerance_px):
            for region, distance in distances.items():
                if distance >= -reach:
                    return region
        return None

    def at_goal(self, coordinates: Sequence[tuple[float, float]]) -> None:
        """None: labels do not say what belongs where."""

    @property
    def goal_pixel_m(self) -> None:
        """None: labels do not say how large things are."""


@final
@dataclass(frozen=True, eq=False)
class Regions(Labels):
    """The labeled frames of one sequence.

    Attributes:
        name: the file, for messages.
        image_size: width and height in pixels of the images that were labeled.
        labeled: the polygons of each labeled frame by its number; at least one frame.
    """

    name: str
    image_size: tuple[int, int]
    labeled: Mapping[int, FrameRegions]

    @property
    def first_frame(self) -> int:
        """The smallest number of a labeled frame."""
        return min(self.labeled)

    @property
    def last_frame(self) -> int:
        """The largest number of a labeled frame."""
        return max(self.labeled)

    def at(self, frame: int) -> FrameRegions | None:
        """See :meth:`Labels.at`; None before the first and after the last labeled frame, for nothing is extrapolated.

        Between two labeled frames a region moves linearly, vertex by vertex. Where their numbers of vertices differ,
        or the region is out of view on one of them, it is the polygon of the nearer labeled frame, and halfway that of
        the earlier one.
        """
        if not self.first_frame <= frame <= self.last_frame:
            return None
        before = max(number for number in self.labeled if number <= frame)
        after = min(number for number in self.labeled if number >= frame)
        share = (frame - before) / max(after - before, 1)
        earlier, later = self.labeled[before].polygons, self.labeled[after].polygons
        return FrameRegions({region: _between(earlier[region], later[region], share) for region in Region})

    def require_size(self, image_size: tuple[int, int]) -> None:
        """Raises InputError unless ``image_size``, the width and height of the video, is that of the labels."""
        if image_size != self.image_size:
            raise InputError(
                f"{self.name}: image_size is {_size(self.image_size)}; expected {_size(image_size)}, the frame size of "
                "the video, since polygons are pixels of its native frames"
            )


def load_regions(
    path: str | Path, image_size: tuple[int, int] | None = None, frame_count: int | None = None
) -> Regions:
    """Reads a regions file and checks it against the video it is meant for.

    Args:
        path: the JSON file.
        image_size: width and height of the video's frames; None when they are not known yet.
        frame_count: the number of the video's frames; None when it is not known.

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


def _between(earlier: Polygon, later: Polygon, share: float) -> Polygon:
    if len(earlier) != len(later):
        return earlier if share <= 0.5 else later
    return np.asarray((1.0 - share) * earlier + share * later, np.float32)


def _read_json(path: str | Path) -> dict[str, Any]:
    try:
        text = Path(path).read_text(encoding="utf-8")
    except FileNotFoundError:
        raise InputError(f"{path}: no such file; expected a regions file (JSON)") from None
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: cannot be read ({error}); expected a regions file (JSON)") from error
    try:
        content = json.loads(text, object_pairs_hook=_without_repetition)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None
    except (ValueError, RecursionError) as error:
        raise InputError(f"{path}: not valid JSON ({error}); expected a regions file") from error
    if not isinstance(content, dict):
        raise InputError(f"{path}: holds {_shown(content)}; expected an object with the keys image_size and frames")
    return content


def _without_repetition(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    # Python's reader would silently keep the last of two entries with one key.
    content = dict(pairs)
    if len(content) < len(pairs):
        keys = [key for key, _ in pairs]
        repeated = next(key for key in keys if keys.count(key) > 1)
        raise InputError(f"the key {repeated!r} occurs more than once in one object; expected each once")
    return content


def _parsed_size(path: str | Path, value: Any) -> tuple[int, int]:
    whole = isinstance(value, list) and all(isinstance(side, int) and not isinstance(side, bool) for side in value)
    if not (whole and len(value) == 2 and min(value) > 0):
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
    names = ", ".join(Region)
    if not isinstance(value, dict):
        raise InputError(f"{path}: frame {key} is {_shown(value)}; expected an object with the regions {names}")
    for name in value:
        if name not in set(Region):
            raise InputError(f"{path}: frame {key} has the unknown region {_shown(name)}; expected {names}")
    for region in Region:
        if region not in value:
            raise InputError(f"{path}: frame {key} has no region '{region}'; expected its polygon, or [] out of view")
    return FrameRegions({region: _parsed_polygon(path, key, region, value[region]) for region in Region})


def _parsed_polygon(path: str | Path, key: str, region: Region, vertices: Any) -> Polygon:
    place = f"{path}: frame {key}, region '{region}'"
    if not isinstance(vertices, list):
        raise InputError(f"{place} is {_shown(vertices)}; expected a list of vertices [x, y]")
    if 0 < len(vertices) < 3:
        raise InputError(f"{place} has {len(vertices)} vertices; expected at least 3, or [] where it is out of view")
    for number, vertex in enumerate(vertices):
        if not (isinstance(vertex, list) and len(vertex) == 2 and all(_is_coordinate(value) for value in vertex)):
            raise InputError(f"{place}, vertex {number} is {_shown(vertex)}; expected [x, y] in pixels")
    return np.array(vertices, np.float32).reshape(-1, 2)


def _is_coordinate(value: Any) -> bool:
    # A polygon may reach beyond the picture. The bound keeps NaN, infinity and what overflows float32 out.
    return isinstance(value, int | float) and not isinstance(value, bool) and -1e6 <= value <= 1e6


def _shown(value: Any) -> str:
    text = json.dumps(value)
    return text if len(text) <= 60 else f"{text[:57]}..."


def _size(image_size: tuple[int, int]) -> str:
    return f"{image_size[0]}x{image_size[1]}"
