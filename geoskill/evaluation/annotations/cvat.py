"""CVAT's files: XML 1.1, "for images" and "for video".

https://docs.cvat.ai/docs/manual/advanced/xml_format; read are polygons, boxes, ellipses and masks, on their own or in
tracks. Document types, and so entities, which unfold or read other files, are refused.
"""

import math
from collections.abc import Iterator
from pathlib import Path, PurePosixPath
from typing import Any
from xml.etree import ElementTree
from xml.parsers import expat

from geoskill.errors import InputError, shown
from geoskill.evaluation.annotations.picture import (
    LabeledPicture,
    Shape,
    ellipse,
    mask_of_runs,
    rectangle,
    shape_of_mask,
)
from geoskill.evaluation.regions import polygon_of
from geoskill.io.text_file import is_coordinate

# CVAT's files are four deep.
MAX_DEPTH = 20


def cvat_pictures(path: str | Path, text: str) -> Iterator[LabeledPicture]:
    """Yield the pictures that have shapes.

    Raises:
        InputError: when the text is not CVAT's.
    """
    root = _parsed(path, text)
    if root.tag != "annotations":
        raise InputError(f"{path}: begins with {shown(root.tag)}; expected CVAT's <annotations>")
    for image in root.iter("image"):
        origin = f"{path}: {shown(image.get('name', 'an image'))}"
        found = [_shape(origin, own, own.get("label", "")) for own in image]
        shapes = [own for own in found if own is not None]
        if shapes:
            size = int(_number(origin, image, "width")), int(_number(origin, image, "height"))
            yield LabeledPicture(origin, PurePosixPath(image.get("name", "")).name, None, size, shapes)
    tracks = list(root.iter("track"))
    if tracks:
        yield from _tracked(path, root, tracks)


def _tracked(
    path: str | Path, root: ElementTree.Element, tracks: list[ElementTree.Element]
) -> Iterator[LabeledPicture]:
    size_element = root.find(".//original_size")
    sides = [size_element.findtext(side, "") for side in ("width", "height")] if size_element is not None else []
    if not sides or not all(side.isascii() and side.isdigit() and len(side) < 7 for side in sides):
        raise InputError(f"{path}: has no original_size; expected that of the video, as CVAT's format for video has it")
    by_frame: dict[int, list[Shape]] = {}
    for track in tracks:
        for element in track:
            number = element.get("frame", "")
            origin = f"{path}: track {shown(track.get('id', ''))}"
            shape = _shape(origin, element, track.get("label", ""))
            if shape is None:
                continue
            if not (number.isascii() and number.isdigit() and len(number) < 10):
                raise InputError(f"{origin}: frame is {shown(number)}; expected a whole number from 0 on")
            shapes = by_frame.setdefault(int(number), [])
            if element.get("outside") != "1":
                shapes.append(shape)
    for frame, shapes in by_frame.items():
        yield LabeledPicture(f"{path}: frame {frame}", "", frame, (int(sides[0]), int(sides[1])), shapes)


def _shape(origin: str, element: ElementTree.Element, label: str) -> Shape | None:
    """Return what an element encloses, or None."""

    def numbers(*names: str) -> list[float]:
        return [_number(origin, element, name) for name in names]

    if element.tag == "polygon":
        points = [pair.split(",") for pair in element.get("points", "").split(";")]
        vertices = [[_coordinate(origin, "points", value) for value in pair] for pair in points]
        if len(vertices) < 3 or any(len(pair) != 2 for pair in vertices):
            raise InputError(f"{origin}: points is {shown(element.get('points'))}; expected x,y of 3 vertices or more")
        return Shape(label, [polygon_of(vertices)])
    if element.tag == "box":
        left, top, right, bottom = numbers("xtl", "ytl", "xbr", "ybr")
        turned = _number(origin, element, "rotation") if element.get("rotation") else 0.0
        return Shape(label, [rectangle(left, top, right, bottom, turned)])
    if element.tag == "ellipse":
        return Shape(label, [ellipse(*numbers("cx", "cy", "rx", "ry"))])
    if element.tag == "mask":
        left, top, width, height = (int(number) for number in numbers("left", "top", "width", "height"))
        texts = [own.strip() for own in element.get("rle", "").split(",")]
        if not all(own.isascii() and own.isdigit() and len(own) < 10 for own in texts):
            raise InputError(f"{origin}: rle is {shown(element.get('rle'))}; expected lengths of runs")
        mask = mask_of_runs(origin, [int(own) for own in texts], height, width, by_column=False)
        return shape_of_mask(origin, label, mask, (left, top))
    return None


def _number(origin: str, element: ElementTree.Element, name: str) -> float:
    return _coordinate(origin, name, element.get(name))


def _coordinate(origin: str, name: str, text: str | None) -> float:
    try:
        value = float(text or "")
    except ValueError:
        value = math.nan
    if not is_coordinate(value):
        raise InputError(f"{origin}: {name} is {shown(text)}; expected a number of pixels")
    return value


def _parsed(path: str | Path, text: str) -> ElementTree.Element:
    builder = ElementTree.TreeBuilder()
    depth = 0

    def start(tag: str, attributes: dict[str, str]) -> None:
        nonlocal depth
        depth += 1
        if depth > MAX_DEPTH:
            raise InputError(f"{path}: elements are more than {MAX_DEPTH} deep; expected CVAT's XML")
        builder.start(tag, attributes)

    def end(tag: str) -> None:
        nonlocal depth
        depth -= 1
        builder.end(tag)

    def refuse(*_: Any) -> None:
        raise InputError(f"{path}: declares a document type; expected CVAT's XML, which has none")

    parser = expat.ParserCreate()
    parser.StartDoctypeDeclHandler = refuse
    parser.StartElementHandler = start
    parser.EndElementHandler = end
    parser.CharacterDataHandler = builder.data
    try:
        parser.Parse(text, True)
    except expat.ExpatError as error:
        raise InputError(f"{path}: not valid XML ({error}); expected CVAT's") from None
    return builder.close()
