"""LabelMe's files: JSON, one for each picture, beside it.

https://github.com/wkentaro/labelme; read are polygons, rectangles, circles and masks.
"""

import base64
import binascii
import math
from collections.abc import Mapping
from pathlib import Path, PurePosixPath, PureWindowsPath
from typing import Any

from geoskill.errors import InputError
from geoskill.evaluation.annotations.mask_picture import decoded_mask
from geoskill.evaluation.annotations.picture import LabeledPicture, Shape, ellipse, rectangle, shape_of_mask
from geoskill.evaluation.regions import Polygon, polygon_of
from geoskill.io.text_file import is_coordinate, written


def labelme_picture(path: str | Path, content: Mapping[str, Any]) -> LabeledPicture:
    """Return the shapes of one file.

    Shapes that enclose nothing (points, lines) are left out.

    Raises:
        InputError: when the content is not as LabelMe writes it.
    """
    size = content.get("imageWidth"), content.get("imageHeight")
    name = content.get("imagePath")
    shapes = content.get("shapes")
    if not all(isinstance(side, int) and not isinstance(side, bool) and 0 < side < 10**6 for side in size):
        raise InputError(f"{path}: imageWidth and imageHeight are {written(size)}; expected pixels, as LabelMe writes")
    if not isinstance(name, str) or not isinstance(shapes, list):
        raise InputError(f"{path}: imagePath or shapes is missing; expected a file of LabelMe")
    found = [_shape(f"{path}: shape {number}", own, size) for number, own in enumerate(shapes)]  # type: ignore[arg-type]
    file = PureWindowsPath(name).name if "\\" in name else PurePosixPath(name).name
    kept = [own for own in found if own is not None]
    return LabeledPicture(str(path), file, None, size, kept)  # type: ignore[arg-type]


def _shape(origin: str, shape: Any, size: tuple[int, int]) -> Shape | None:
    if not isinstance(shape, dict) or not isinstance(shape.get("label"), str):
        raise InputError(f"{origin} is {written(shape)}; expected one with a label")
    label, kind, points = shape["label"], shape.get("shape_type", "polygon"), shape.get("points")
    if not isinstance(points, list) or not all(
        isinstance(point, list) and len(point) == 2 and all(map(is_coordinate, point)) for point in points
    ):
        raise InputError(f"{origin}: points is {written(points)}; expected a list of [x, y] in pixels")
    if kind == "mask":
        return _mask(origin, shape, label, size)
    outline = _outline(kind, points)
    return None if outline is None else Shape(label, [outline])


def _outline(kind: Any, points: list[list[float]]) -> Polygon | None:
    if kind in ("polygon", "oriented_rectangle", None) and len(points) >= 3:
        return polygon_of(points)
    if kind == "rectangle" and len(points) == 2:
        (x1, y1), (x2, y2) = points
        return rectangle(min(x1, x2), min(y1, y2), max(x1, x2), max(y1, y2))
    if kind == "rectangle" and len(points) == 4:  # LabelMe 5.9 and later
        return polygon_of(points)
    if kind == "circle" and len(points) == 2:
        (x, y), (x_on, y_on) = points
        radius = math.hypot(x_on - x, y_on - y)
        return ellipse(x, y, radius, radius)
    return None


def _mask(origin: str, shape: Mapping[str, Any], label: str, size: tuple[int, int]) -> Shape:
    try:
        data = base64.b64decode(shape.get("mask", ""), validate=True)
    except (binascii.Error, TypeError, ValueError):
        raise InputError(f"{origin}: its mask is no base64; expected a picture") from None
    mask = decoded_mask(origin, data)
    if mask.shape[0] > size[1] or mask.shape[1] > size[0] or not shape["points"]:
        raise InputError(f"{origin}: its mask is larger than the picture, or has no corner")
    left, top = (int(coordinate) for coordinate in shape["points"][0])
    return shape_of_mask(origin, label, mask > 0, (left, top))
