"""Labels of other programs, written as these write them, and read as regions."""

import base64
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from PIL import Image

from geoskill.errors import InputError
from geoskill.evaluation.annotations.assignment import RoleNames
from geoskill.evaluation.annotations.load import load_regions
from geoskill.evaluation.regions import Regions
from geoskill.simulation.roles import SceneRole

# In a picture of 40 x 30: the mug covers x 4 to 10, y 6 to 12; the coaster x 20 to 30, y 15 to 25.
MUG, COASTER = [[4, 6], [10, 6], [10, 12], [4, 12]], [[20, 15], [30, 15], [30, 25], [20, 25]]
NAMES = RoleNames("mug", "coaster")
STEMS = ["a", "b", "c", "d"]


def mask_of(polygon: list[list[int]]) -> np.ndarray:
    mask = np.zeros((30, 40), np.uint8)
    (left, top), _, (right, bottom), _ = polygon
    mask[top : bottom + 1, left : right + 1] = 1
    return mask


def labelme(name: str, *shapes: dict[str, Any]) -> dict[str, Any]:
    header = {
        "version": "5.5.0",
        "flags": {},
        "imagePath": name,
        "imageData": None,
        "imageHeight": 30,
        "imageWidth": 40,
    }
    return {**header, "shapes": list(shapes)}


def shape(label: str, points: Any, kind: str = "polygon", **more: Any) -> dict[str, Any]:
    return {"label": label, "points": points, "group_id": None, "shape_type": kind, "flags": {}, **more}


BOTH = shape("mug", MUG), shape("coaster", COASTER)


def write_labelme(folder: Path) -> Path:
    for name in ("b", "d"):
        content = labelme(f"{name}.jpg", shape("mug", MUG), shape("coaster", [[30, 15], [20, 25]], "rectangle"))
        (folder / f"{name}.json").write_text(json.dumps(content))
    return folder


def write_coco(folder: Path) -> Path:
    runs = [*_runs(mask_of(COASTER).T.reshape(-1))]
    content = {
        "images": [
            {"id": 7, "file_name": "images/b.jpg", "width": 40, "height": 30},
            {"id": 9, "file_name": "d.jpg", "width": 40, "height": 30},
            {"id": 10, "file_name": "c.jpg", "width": 40, "height": 30},  # nobody has labeled it
        ],
        "categories": [{"id": 1, "name": "mug"}, {"id": 2, "name": "coaster"}],
        "annotations": [
            {"id": 1, "image_id": 7, "category_id": 1, "segmentation": [[4, 6, 10, 6, 10, 12, 4, 12]], "iscrowd": 0},
            {"id": 2, "image_id": 7, "category_id": 2, "segmentation": {"size": [30, 40], "counts": runs}},
            {"id": 3, "image_id": 9, "category_id": 1, "bbox": [4, 6, 6, 6]},
            {"id": 4, "image_id": 9, "category_id": 2, "segmentation": {"size": [30, 40], "counts": packed(runs)}},
        ],
    }
    path = folder / "instances.json"
    path.write_text(json.dumps(content))
    return path


def write_cvat_images(folder: Path) -> Path:
    runs = ", ".join(map(str, [0, 121]))  # 11 x 11 pixels, all of them inside
    images = "".join(
        f'<image id="{number}" name="{name}.jpg" width="40" height="30">'
        '<polygon label="mug" source="manual" occluded="0" points="4.00,6.00;10.00,6.00;10.00,12.00;4.00,12.00"/>'
        f'<mask label="coaster" source="auto" rle="{runs}" left="20" top="15" width="11" height="11" z_order="0"/>'
        '<points label="corner" points="1,1"/></image>'
        for number, name in ((1, "b"), (3, "d"))
    )
    unlabeled = '<image id="2" name="c.jpg" width="40" height="30"></image>'
    path = folder / "annotations.xml"
    path.write_text(f'<?xml version="1.0" encoding="utf-8"?>\n<annotations>{images}{unlabeled}</annotations>')
    return path


def write_cvat_video(folder: Path) -> Path:
    box = 'xtl="20.00" ytl="15.00" xbr="30.00" ybr="25.00"'
    content = (
        "<annotations><version>1.1</version><meta><task><original_size><width>40</width><height>30</height>"
        '</original_size></task></meta><track id="0" label="mug">'
        '<polygon frame="1" keyframe="1" outside="0" occluded="0" points="4,6;10,6;10,12;4,12"/>'
        '<polygon frame="3" keyframe="0" outside="0" occluded="0" points="4,6;10,6;10,12;4,12"/></track>'
        f'<track id="1" label="coaster"><box frame="1" outside="0" {box}/><box frame="3" outside="0" {box}/></track>'
        '<track id="2" label="hand"><box frame="1" outside="0" xtl="35" ytl="0" xbr="39" ybr="9"/>'
        '<box frame="3" outside="1" xtl="35" ytl="0" xbr="39" ybr="9"/></track></annotations>'
    )
    path = folder / "annotations.xml"
    path.write_text(content)
    return path


def write_palette_masks(folder: Path) -> Path:
    for name in ("b", "d"):
        picture = Image.new("P", (40, 30))
        picture.putdata([int(value) for value in (mask_of(MUG) + 2 * mask_of(COASTER)).reshape(-1)])
        picture.putpalette([0, 0, 0, 128, 0, 0, 0, 128, 0])
        picture.save(folder / f"{name}.png")
    return folder


def write_object_masks(folder: Path) -> Path:
    for label, polygon in (("mug", MUG), ("coaster", COASTER)):
        (folder / label).mkdir()
        for name in ("b", "d"):
            cv2.imwrite(str(folder / label / f"{name}.png"), 255 * mask_of(polygon))
    return folder


def _runs(flat: np.ndarray) -> list[int]:
    changes = np.flatnonzero(np.diff(np.concatenate([[0], flat, [1 - flat[-1]]])))
    return [int(own) for own in np.diff(np.concatenate([[0], changes]))]


def packed(runs: list[int]) -> str:
    """As COCO's ``rleToString``: differences to the last but one, five bits a character, the last with its sign."""
    text = ""
    for number, run in enumerate(runs):
        value = run - (runs[number - 2] if number > 2 else 0)
        more = True
        while more:
            bits = value & 0x1F
            value >>= 5
            more = value != -1 if bits & 0x10 else value != 0
            text += chr(48 + (bits | 0x20 if more else bits))
    return text


WRITERS = [
    (write_labelme, NAMES),
    (write_coco, NAMES),
    (write_cvat_images, NAMES),
    (write_cvat_video, NAMES),
    (write_palette_masks, RoleNames("1", "002")),
    (write_object_masks, NAMES),
]


@pytest.mark.parametrize(("write", "names"), WRITERS, ids=lambda own: getattr(own, "__name__", "names"))
def test_every_format_gives_the_same_regions(write: Callable[[Path], Path], names: RoleNames, tmp_path: Path) -> None:
    regions = load_regions(write(tmp_path), (40, 30), 4, names, STEMS)
    assert sorted(regions.labeled) == [1, 3]
    assert regions.image_size == (40, 30)
    for number in (1, 2, 3):
        at = regions.at(number)
        assert at is not None
        assert at.signed_distance(SceneRole.OBJECT, (7.0, 9.0)) == 3.0
        assert at.signed_distance(SceneRole.OBJECT, (2.0, 9.0)) == -2.0
        assert at.signed_distance(SceneRole.TARGET, (25.0, 20.0)) == 5.0
        assert at.signed_distance(SceneRole.TARGET, (25.0, 27.0)) == -2.0
    last = regions.at(3)
    assert last is not None
    assert last.signed_distance(SceneRole.AGENT, (37.0, 5.0)) == -np.inf


def test_hand_of_a_track_that_leaves(tmp_path: Path) -> None:
    first = load_regions(write_cvat_video(tmp_path), names=NAMES).at(1)
    assert first is not None
    assert first.label((37.0, 5.0)) is SceneRole.AGENT


def one(folder: Path, *shapes: dict[str, Any]) -> Regions:
    (folder / "0.json").write_text(json.dumps(labelme("0.png", *shapes)))
    return load_regions(folder / "0.json", names=RoleNames("mug", "mug 2"))


def test_pieces_and_holes(tmp_path: Path) -> None:
    """A ring of 3 pixels around 10 to 20, and a second piece of the same label."""
    ring = np.zeros((21, 21), np.uint8)
    ring[:], ring[4:17, 4:17] = 255, 0
    data = base64.b64encode(cv2.imencode(".png", ring)[1].tobytes()).decode()
    corners = [[5, 4], [25, 24]]
    regions = one(
        tmp_path,
        shape("mug", corners, "mask", mask=data),
        shape("mug", [[30, 2], [38, 2], [38, 10], [30, 10]]),
        shape("mug 2", [[34, 20], [34, 23]], "circle"),
        shape("edge", [[0, 0], [1, 1]], "line"),
    )
    at = regions.at(0)
    assert at is not None
    assert at.signed_distance(SceneRole.OBJECT, (7.0, 14.0)) == pytest.approx(1.0)  # from the hole, whose rim is x = 8
    assert at.signed_distance(SceneRole.OBJECT, (15.0, 14.0)) == pytest.approx(-7.0)  # in the middle of the hole
    assert at.signed_distance(SceneRole.OBJECT, (34.0, 6.0)) == 4.0  # in the other piece
    assert at.signed_distance(SceneRole.TARGET, (34.0, 20.0)) == pytest.approx(3.0, abs=0.01)
    assert at.signed_distance(SceneRole.TARGET, (39.0, 20.0)) == pytest.approx(-2.0, abs=0.01)


def test_numbers_in_names_where_the_recording_has_no_names(tmp_path: Path) -> None:
    for name in ("take2_00003", "take2_00005"):
        content = labelme(f"C:\\frames\\{name}.jpg", shape("object", MUG), shape("target", COASTER))
        (tmp_path / f"{name}.json").write_text(json.dumps(content))
    assert sorted(load_regions(tmp_path, frame_count=6).labeled) == [3, 5]
    with pytest.raises(InputError, match=r"00005\.json: frame 5 is beyond the video, which has 5 frames; .* 0 to 4"):
        load_regions(tmp_path, frame_count=5)


@pytest.mark.parametrize(
    ("names", "message"),
    [
        (RoleNames(), r"nothing is labeled 'object'; expected regions\.object=LABEL, one of 'coaster', 'mug'"),
        (RoleNames("mug", "tray"), r"nothing is labeled 'tray'; expected regions\.target=LABEL"),
        (RoleNames("mug", "coaster", "glove"), r"nothing is labeled 'glove'; expected regions\.hand=LABEL"),
        (RoleNames("mug", "mug"), r"regions\.target=mug is regions\.object, too"),
    ],
)
def test_names_that_are_not_there(tmp_path: Path, names: RoleNames, message: str) -> None:
    with pytest.raises(InputError, match=message):
        load_regions(write_labelme(tmp_path), names=names, stems=STEMS)


@pytest.mark.parametrize(
    ("files", "message"),
    [
        (
            {"a.json": labelme("a.jpg", shape("mug", MUG)), "b.json": {"x": 1}},
            "has no shapes; expected files of LabelMe",
        ),
        ({"a.json": labelme("a.jpg", shape("mug", [[1, 2, 3]]))}, "shape 0: points is"),
        ({"a.json": labelme("a.jpg", {"points": MUG})}, "shape 0 is .*; expected one with a label"),
        ({"a.json": {**labelme("a.jpg"), "imageWidth": None}}, "imageWidth and imageHeight"),
        ({"a.json": {**labelme("a.jpg"), "imageWidth": 10**5, "imageHeight": 10**5}}, "at most 33554432 pixels"),
        ({"a.json": labelme("a.jpg", shape("mug", MUG, "mask", mask="%"))}, "no base64"),
        ({"a.json": labelme("a.jpg", shape("mug", MUG, "mask", mask="AAAA"))}, "cannot be read as PNG"),
        ({"a.json": labelme("zero.jpg", *BOTH)}, "labels 'zero.jpg'; expected a picture of the recording"),
        ({"a.json": labelme("a.jpg", *BOTH), "b.json": labelme("x.jpg")}, "labels 'x.jpg'; expected a picture"),
        ({"a.json": labelme("a.jpg", *BOTH), "b.json": labelme("a.jpg")}, "frame 0 is labeled twice"),
        (
            {"a.json": labelme("a.jpg"), "b.json": {**labelme("b.jpg"), "imageWidth": 41}},
            r"b\.json: 41x30; expected 40x30 like others",
        ),
        ({"all.json": {"images": [], "categories": [], "annotations": 3}}, "has no shapes"),
    ],
)
def test_folders_that_are_refused(tmp_path: Path, files: dict[str, Any], message: str) -> None:
    for name, content in files.items():
        (tmp_path / name).write_text(json.dumps(content))
    with pytest.raises(InputError, match=message) as caught:
        load_regions(tmp_path, names=NAMES, stems=STEMS)
    assert "\n" not in str(caught.value)


IMAGE = {"id": 1, "file_name": "a.jpg", "width": 40, "height": 30}


def coco(annotation: Any, image: Any = IMAGE) -> str:
    content = {"images": [image], "categories": [{"id": 1, "name": "mug"}], "annotations": [annotation]}
    return json.dumps(content)


def segmented(segmentation: Any) -> str:
    return coco({"image_id": 1, "category_id": 1, "segmentation": segmentation})


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('{"images": [], "categories": [], "annotations": []}', "nothing is labeled"),
        ('{"images": 1, "categories": [], "annotations": []}', "images is 1; expected a list"),
        (coco({"image_id": 2, "category_id": 1}), "image_id is 2; expected that of one in the file"),
        (coco({"image_id": [], "category_id": 1}), "image_id is"),
        (coco({"image_id": 1, "category_id": 1}), "has neither segmentation nor bbox"),
        (coco({"image_id": 1, "category_id": 1, "bbox": [0, 0, 1]}), "has neither segmentation nor bbox"),
        (coco({"image_id": 1, "category_id": 1, "bbox": [0, 0, 1, 1]}, {**IMAGE, "width": "40"}), "width and height"),
        (segmented([[1, 2, 3, 4]]), "segmentation is .*; expected lists"),
        (segmented({"size": [40, 30], "counts": [1200]}), "another size than its image"),
        (segmented({"size": [30, 40], "counts": [1199]}), "the runs of the mask are not those of 40x30"),
        (segmented({"size": [30, 40], "counts": [-1, 1201]}), "counts is"),
        (segmented({"size": [30, 40], "counts": "ooooooooooooo"}), "a run that is too long"),
        (segmented({"size": [30, 40], "counts": "é"}), "counts is"),
        ("<annotations", "not valid XML"),
        ("<svg/>", "begins with 'svg'; expected CVAT's <annotations>"),
        ("<!DOCTYPE a [<!ENTITY b 'c'>]><annotations/>", "declares a document type"),
        ("<a>" * 30, "elements are more than 20 deep"),
        ("<annotations/>", "nothing is labeled"),
        ("<annotations><track><box/></track></annotations>", "has no original_size"),
        ('<annotations><image name="a"><box label="b" xtl="nan"/></image></annotations>', "xtl is 'nan'; expected"),
        ('<annotations><image name="a"><polygon points="1,2;3,4"/></image></annotations>', "expected x,y of 3"),
        (
            '<annotations><image name="a"><mask left="0" top="0" width="9" height="9" rle="-1"/></image></annotations>',
            "rle is '-1'; expected lengths of runs",
        ),
        (
            '<annotations><image name="a"><mask left="0" top="0" width="999999" height="999999" rle="1"/></image>'
            "</annotations>",
            "the runs of the mask are not those",
        ),
    ],
)
def test_files_that_are_refused(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "labels"
    path.write_text(text)
    with pytest.raises(InputError, match=message) as caught:
        load_regions(path, names=NAMES, stems=STEMS)
    assert str(caught.value).startswith(str(path))
    assert "\n" not in str(caught.value)


def test_masks_that_are_refused(tmp_path: Path) -> None:
    cv2.imwrite(str(tmp_path / "0.png"), np.zeros((3, 3, 3), np.uint8))
    with pytest.raises(InputError, match=r"0\.png: a picture in colors \(RGB\); expected a palette or grays"):
        load_regions(tmp_path)
    noise = np.random.default_rng(0).integers(0, 2, (300, 300)).astype(np.uint8)
    cv2.imwrite(str(tmp_path / "0.png"), noise)
    with pytest.raises(InputError, match=r"0\.png: the mask '1' is in \d+ pieces; expected"):
        load_regions(tmp_path)
    cv2.imwrite(str(tmp_path / "0.png"), np.arange(400, dtype=np.uint16).reshape(20, 20))
    with pytest.raises(InputError, match=r"0\.png: has 399 values; expected numbers of at most 256 objects"):
        load_regions(tmp_path)


def test_own_files_have_no_other_labels(tmp_path: Path) -> None:
    path = tmp_path / "own.json"
    path.write_text('{"image_size": [4, 4], "frames": {"0": {"object": [], "target": [], "hand": []}}}')
    assert load_regions(path).first_frame == 0
    with pytest.raises(InputError, match=r"expected no regions\.object"):
        load_regions(path, names=NAMES)
