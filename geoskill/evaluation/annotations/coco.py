"""COCO's instance annotations: one JSON file for all pictures.

https://cocodataset.org/#format-data; read are polygons, masks as runs (compressed or not) and, where an annotation has
no segmentation, its box.
"""

from collections.abc import Iterator, Mapping
from pathlib import Path, PurePosixPath
from typing import Any

from geoskill.errors import InputError
from geoskill.evaluation.annotations.picture import LabeledPicture, Shape, mask_of_runs, rectangle, shape_of_mask
from geoskill.evaluation.regions import polygon_of
from geoskill.io.text_file import is_coordinate, written


def coco_pictures(path: str | Path, content: Mapping[str, Any]) -> Iterator[LabeledPicture]:
    """Yield the pictures that have annotations.

    Raises:
        InputError: when the content is not COCO's.
    """
    images = _by_id(path, "images", content)
    categories = _by_id(path, "categories", content)
    shapes: dict[Any, list[Shape]] = {}
    annotations = content["annotations"]
    if not isinstance(annotations, list):
        raise InputError(f"{path}: annotations is {written(annotations)}; expected a list")
    for number, annotation in enumerate(annotations):
        origin = f"{path}: annotation {number}"
        if not isinstance(annotation, dict):
            raise InputError(f"{origin} is {written(annotation)}; expected an object")
        image = _referred(origin, "image_id", annotation, images)
        category = _referred(origin, "category_id", annotation, categories)
        shape = _shape(origin, str(category.get("name")), annotation, _size(origin, image))
        shapes.setdefault(annotation["image_id"], []).append(shape)
    for key, own in shapes.items():
        name = images[key].get("file_name")
        if not isinstance(name, str):
            raise InputError(f"{path}: image {written(key)} has no file_name; expected one")
        yield LabeledPicture(str(path), PurePosixPath(name).name, None, _size(f"{path}: {name}", images[key]), own)


def _by_id(path: str | Path, key: str, content: Mapping[str, Any]) -> dict[Any, dict[str, Any]]:
    entries = content[key]
    if not isinstance(entries, list) or not all(
        isinstance(entry, dict) and isinstance(entry.get("id"), int | str) for entry in entries
    ):
        raise InputError(f"{path}: {key} is {written(entries)}; expected a list of objects with an id")
    return {entry["id"]: entry for entry in entries}


def _referred(origin: str, key: str, annotation: Mapping[str, Any], among: Mapping[Any, Any]) -> Mapping[str, Any]:
    value = annotation.get(key)
    if not isinstance(value, int | str) or value not in among:
        raise InputError(f"{origin}: {key} is {written(value)}; expected that of one in the file")
    found: Mapping[str, Any] = among[value]
    return found


def _size(origin: str, image: Mapping[str, Any]) -> tuple[int, int]:
    size = image.get("width"), image.get("height")
    if not all(isinstance(side, int) and not isinstance(side, bool) and 0 < side < 10**6 for side in size):
        raise InputError(f"{origin}: its image has width and height {written(size)}; expected pixels")
    return size  # type: ignore[return-value]


def _shape(origin: str, label: str, annotation: Mapping[str, Any], size: tuple[int, int]) -> Shape:
    segmentation, box = annotation.get("segmentation"), annotation.get("bbox")
    if isinstance(segmentation, dict):
        if segmentation.get("size") != [size[1], size[0]]:
            raise InputError(f"{origin}: its mask has another size than its image; expected [height, width]")
        runs = _runs(origin, segmentation.get("counts"), size[0] * size[1])
        return shape_of_mask(origin, label, mask_of_runs(origin, runs, size[1], size[0], by_column=True))
    if segmentation:
        if not isinstance(segmentation, list) or not all(map(_is_polygon, segmentation)):
            raise InputError(f"{origin}: segmentation is {written(segmentation)}; expected lists of x, y of 3 vertices")
        return Shape(label, [polygon_of(list(zip(own[::2], own[1::2], strict=True))) for own in segmentation])
    if not isinstance(box, list) or len(box) != 4 or not all(map(is_coordinate, box)):
        raise InputError(f"{origin}: has neither segmentation nor bbox; expected one of them")
    left, top, width, height = box
    return Shape(label, [rectangle(left, top, left + width, top + height)])


def _is_polygon(value: Any) -> bool:
    return isinstance(value, list) and len(value) >= 6 and len(value) % 2 == 0 and all(map(is_coordinate, value))


def _runs(origin: str, counts: Any, pixels: int) -> list[int]:
    """Return the lengths of runs, which COCO may store as text (``rleFrString`` of its ``maskApi.c``)."""
    if isinstance(counts, list) and all(isinstance(own, int) and 0 <= own <= pixels for own in counts):
        return counts
    if not isinstance(counts, str) or not all(48 <= ord(own) < 112 for own in counts):
        raise InputError(f"{origin}: counts is {written(counts)}; expected lengths of runs")
    runs: list[int] = []
    value = shift = 0
    for character in counts:
        bits = ord(character) - 48
        value |= (bits & 0x1F) << shift
        shift += 5
        if bits & 0x20:
            if shift > 40:
                raise InputError(f"{origin}: counts has a run that is too long; expected at most {pixels}")
            continue
        if bits & 0x10:
            value -= 1 << shift
        runs.append(value + (runs[-2] if len(runs) > 2 else 0))
        value = shift = 0
    return runs
