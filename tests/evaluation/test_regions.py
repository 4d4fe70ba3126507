"""Tests of reading regions, interpolating them, and labeling points."""

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from geoskill.errors import InputError
from geoskill.evaluation.annotations.load import load_regions
from geoskill.evaluation.regions import FrameRegions
from geoskill.simulation.roles import SceneRole

SQUARE = [[0, 0], [10, 0], [10, 10], [0, 10]]
TRIANGLE = [[20, 0], [30, 0], [20, 10]]


def frame(**changed: Any) -> dict[str, Any]:
    return {"object": SQUARE, "target": TRIANGLE, "hand": []} | changed


def write(folder: Path, content: Any) -> Path:
    path = folder / "labels.json"
    path.write_text(content if isinstance(content, str) else json.dumps(content))
    return path


def labels(frames: Any, image_size: Any = (64, 48)) -> dict[str, Any]:
    return {"sequence": "made up", "image_size": image_size, "frames": frames}


def rectangle(left: float, top: float, right: float, bottom: float) -> np.ndarray:
    return np.array([[left, top], [right, top], [right, bottom], [left, bottom]], np.float32)


NOTHING = np.zeros((0, 2), np.float32)
# The object and the target share 8 <= x <= 10; the hand lies 2 px right of the target.
SCENE = FrameRegions(
    {
        SceneRole.OBJECT: rectangle(0, 0, 10, 10),
        SceneRole.TARGET: rectangle(8, 0, 20, 10),
        SceneRole.AGENT: rectangle(22, 0, 40, 10),
    }
)


@pytest.mark.parametrize(
    ("x", "expected"),
    [
        (-3.5, None),
        (-3.0, SceneRole.OBJECT),  # exactly the tolerance
        (5.0, SceneRole.OBJECT),
        (9.0, SceneRole.OBJECT),  # in both: the object first
        (10.0, SceneRole.OBJECT),  # on its outline
        (11.0, SceneRole.TARGET),  # in the target, 1 px from the object: being in goes before being near
        (21.0, SceneRole.TARGET),  # in neither, 1 px from target and hand
        (22.5, SceneRole.AGENT),  # in the hand, 2.5 px from the target
        (42.0, SceneRole.AGENT),
        (43.5, None),
    ],
)
def test_label_along_a_row(x: float, expected: SceneRole | None) -> None:
    assert SCENE.label((x, 5.0)) is expected


def test_label_among_some_regions() -> None:
    assert SCENE.label((22.5, 5.0), among=(SceneRole.OBJECT, SceneRole.TARGET)) is SceneRole.TARGET
    assert SCENE.label((9.0, 5.0), among=(SceneRole.TARGET, SceneRole.OBJECT)) is SceneRole.TARGET


def test_contains_ignores_other_regions() -> None:
    assert SCENE.contains(SceneRole.OBJECT, (9.0, 5.0))
    assert SCENE.contains(SceneRole.TARGET, (9.0, 5.0))
    assert SCENE.contains(SceneRole.OBJECT, (12.0, 5.0))
    assert not SCENE.contains(SceneRole.OBJECT, (12.0, 5.0), tolerance_px=0.0)
    assert SCENE.contains(SceneRole.OBJECT, (10.0, 5.0), tolerance_px=0.0)


def test_signed_distance_beyond_a_corner() -> None:
    # (-3, -4) is 5 px from the corner (0, 0), though within 4 px along either axis.
    assert SCENE.signed_distance(SceneRole.OBJECT, (-3.0, -4.0)) == pytest.approx(-5.0)
    assert not SCENE.contains(SceneRole.OBJECT, (-3.0, -4.0), tolerance_px=4.9)
    assert SCENE.contains(SceneRole.OBJECT, (-3.0, -4.0), tolerance_px=5.1)


def test_label_in_concave_region() -> None:
    notched = np.array([[0, 0], [20, 0], [20, 20], [10, 4], [0, 20]], np.float32)
    scene = FrameRegions({SceneRole.OBJECT: notched, SceneRole.TARGET: NOTHING, SceneRole.AGENT: NOTHING})
    assert scene.label((10.0, 2.0)) is SceneRole.OBJECT
    assert scene.label((10.0, 16.0)) is None


def test_label_of_region_out_of_view() -> None:
    scene = FrameRegions(dict.fromkeys(SceneRole, NOTHING))
    assert scene.signed_distance(SceneRole.AGENT, (0.0, 0.0)) == -math.inf
    assert not scene.contains(SceneRole.AGENT, (0.0, 0.0), tolerance_px=1e9)
    assert scene.label((0.0, 0.0)) is None


def test_regions_at_interpolates_linearly(tmp_path: Path) -> None:
    moved = [[40, 4], [50, 4], [50, 14], [40, 14]]
    # In an order that is neither that of the numbers nor that of their text.
    path = write(tmp_path, labels({"10": frame(object=moved), "2": frame()}))
    regions = load_regions(path, (64, 48), 11)
    assert (regions.first_frame, regions.last_frame) == (2, 10)
    halfway, quarter = regions.at(6), regions.at(4)
    assert halfway is not None
    assert quarter is not None
    np.testing.assert_allclose(halfway.polygons[SceneRole.OBJECT], [[20, 2], [30, 2], [30, 12], [20, 12]])
    np.testing.assert_allclose(quarter.polygons[SceneRole.OBJECT][0], [10, 1])
    np.testing.assert_allclose(halfway.polygons[SceneRole.TARGET], TRIANGLE)
    assert halfway.polygons[SceneRole.AGENT].shape == (0, 2)


def test_regions_at_labeled_frames(tmp_path: Path) -> None:
    regions = load_regions(write(tmp_path, labels({"2": frame(), "4": frame(object=TRIANGLE)})))
    for number, expected in ((2, SQUARE), (4, TRIANGLE)):
        at = regions.at(number)
        assert at is not None
        np.testing.assert_array_equal(at.polygons[SceneRole.OBJECT], np.array(expected, np.float32))


def test_regions_at_does_not_extrapolate(tmp_path: Path) -> None:
    regions = load_regions(write(tmp_path, labels({"2": frame(), "4": frame()})))
    assert regions.at(1) is None
    assert regions.at(5) is None
    assert regions.at(3) is not None


@pytest.mark.parametrize(("number", "vertices"), [(1, 0), (2, 0), (3, 3), (4, 3)])
def test_regions_at_takes_nearer_polygon_when_vertices_differ(tmp_path: Path, number: int, vertices: int) -> None:
    regions = load_regions(write(tmp_path, labels({"0": frame(hand=[]), "4": frame(hand=TRIANGLE)})))
    at = regions.at(number)
    assert at is not None
    assert len(at.polygons[SceneRole.AGENT]) == vertices


def test_load_regions_checks_video(tmp_path: Path) -> None:
    path = write(tmp_path, labels({"0": frame(), "7": frame()}))
    assert load_regions(path, (64, 48), 8).image_size == (64, 48)
    with pytest.raises(InputError, match=r"labels\.json: frame 7 is beyond the video, which has 7 frames; .* 0 to 6"):
        load_regions(path, (64, 48), 7)
    with pytest.raises(InputError, match=r"labels\.json: image_size is 64x48; expected 48x64"):
        load_regions(path, (48, 64))


def test_require_evaluated(tmp_path: Path) -> None:
    regions = load_regions(write(tmp_path, labels({"6": frame(), "9": frame()})))
    regions.require_evaluated(7, every=3)
    regions.require_evaluated(100, every=8)  # frame 8 lies between the two
    for frame_count, every in ((6, 3), (100, 5), (0, 1)):
        message = rf"labels\.json: labels frames 6 to 9; .* the {frame_count} frames .* \(every={every}\)"
        with pytest.raises(InputError, match=message):
            regions.require_evaluated(frame_count, every)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("", "not valid JSON"),
        ('{"image_size": [64, 48], "frames": {', "not valid JSON"),
        ("[" * 100_000, "not valid JSON"),
        ("[1, 2]", r"holds \[1, 2\]; expected an object"),
        ('{"frames": {}, "frames": {}}', "'frames' occurs more than once"),
        ({"frames": {"0": frame()}}, "'image_size' is missing"),
        ({"image_size": [64, 48]}, "'frames' is missing"),
        (labels({}), "frames is empty; expected at least one labeled frame"),
        (labels([frame()]), "frames is .*; expected an object"),
        (labels({"0": frame()}, [64]), r"image_size is \[64\]; expected \[width, height\]"),
        (labels({"0": frame()}, [64, 0]), r"image_size is \[64, 0\]"),
        (labels({"0": frame()}, [64, 48.5]), r"image_size is \[64, 48.5\]"),
        (labels({"0": frame()}, "64x48"), 'image_size is "64x48"'),
        (labels({"-1": frame()}), 'frame "-1"; expected the frame\'s position'),
        (labels({"1.5": frame()}), 'frame "1.5"'),
        (labels({"007": frame()}), 'frame "007"'),
        (labels({"9" * 5000: frame()}), 'frame "999'),
        (labels({"first": frame()}), 'frame "first"'),
        (labels({"0": SQUARE}), "frame 0 is .*; expected an object with the regions object, target, hand"),
        (labels({"0": frame(hands=[])}), 'frame 0 has the unknown region "hands"; expected object, target, hand'),
        (labels({"3": {"object": SQUARE, "hand": []}}), "frame 3 has no region 'target'"),
        (labels({"3": frame(target=None)}), "frame 3, region 'target' is null; expected a list"),
        (labels({"3": frame(hand=SQUARE[:2])}), "frame 3, region 'hand' has 2 vertices; expected at least 3"),
        (labels({"3": frame(hand=[*SQUARE, [1, 2, 3]])}), r"frame 3, region 'hand', vertex 4 is \[1, 2, 3\]"),
        (labels({"3": frame(object=[[0, 0], [1, "2"], [2, 2]])}), r"region 'object', vertex 1 is \[1, \"2\"\]"),
        (labels({"3": frame(object=[[0, 0], [1, True], [2, 2]])}), r"region 'object', vertex 1 is \[1, true\]"),
        (labels({"3": frame(object=[[0, 0], [1, math.nan], [2, 2]])}), r"vertex 1 is \[1, NaN\]; expected \[x, y\]"),
        (labels({"3": frame(object=[[0, 0], [10**400, 1], [2, 2]])}), "vertex 1 is .*; expected"),
        (labels({"3": frame(object=[0, 0, 1, 1, 2, 2])}), "vertex 0 is 0; expected"),
    ],
)
def test_load_regions_refuses_bad_format(tmp_path: Path, content: Any, message: str) -> None:
    with pytest.raises(InputError, match=message) as caught:
        load_regions(write(tmp_path, content))
    assert str(caught.value).startswith(f"{tmp_path / 'labels.json'}: ")
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < len(str(tmp_path)) + 300


def test_load_regions_with_byte_order_mark(tmp_path: Path) -> None:
    region = {"object": [[1, 1], [9, 1], [9, 9]], "target": [], "hand": []}
    path = tmp_path / "regions.json"
    path.write_text(json.dumps({"image_size": [20, 10], "frames": {"3": region}}), encoding="utf-8-sig")
    assert load_regions(path, (20, 10)).first_frame == 3


def test_load_regions_refuses_unreadable_files(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"absent\.json: no such file"):
        load_regions(tmp_path / "absent.json")
    with pytest.raises(InputError, match=r"holds no labels; expected LabelMe's files \(\*\.json\) or masks"):
        load_regions(tmp_path)
    picture = tmp_path / "picture.jpg"
    picture.write_bytes(b"\xff\xd8\xff\xe0")
    with pytest.raises(InputError, match=r"picture\.jpg: cannot be read"):
        load_regions(picture)


@pytest.mark.parametrize(("sequence", "frames", "labeled"), [("human1", 205, 42), ("robot1", 315, 64)])
def test_load_regions_of_blocks(blocks: Path, sequence: str, frames: int, labeled: int) -> None:
    regions = load_regions(blocks / f"{sequence}.regions.json", (240, 240), frames)
    assert len(regions.labeled) == labeled
    assert (regions.first_frame, regions.last_frame) == (0, frames - 1)
    assert all(regions.at(number) is not None for number in range(frames))
    with pytest.raises(InputError, match="beyond the video"):
        load_regions(blocks / f"{sequence}.regions.json", (240, 240), frames - 1)


def test_label_on_blocks(blocks: Path) -> None:
    regions = load_regions(blocks / "human1.regions.json")
    start, third = regions.at(0), regions.at(3)
    assert start is not None
    assert third is not None
    # The first vertices on frames 0 and 5 are (134.5, 80.9) and (135.3, 81.2).
    np.testing.assert_allclose(third.polygons[SceneRole.OBJECT][0], [134.5 + 0.6 * 0.8, 80.9 + 0.6 * 0.3], atol=1e-4)
    assert start.label((145.0, 100.0)) is SceneRole.OBJECT
    assert start.label((85.0, 145.0)) is SceneRole.TARGET
    assert start.label((210.0, 65.0)) is SceneRole.AGENT
    assert start.label((30.0, 30.0)) is None
    # The cube is carried to the target: its lower edge comes down on the target's upper one.
    end = regions.at(204)
    assert end is not None
    centers = [at.polygons[SceneRole.OBJECT].mean(axis=0) for at in (start, end)]
    target = end.polygons[SceneRole.TARGET].mean(axis=0)
    assert np.linalg.norm(centers[1] - target) < 0.7 * np.linalg.norm(centers[0] - target)


def test_repeated_keys_are_found_in_a_large_file_at_once(tmp_path: Path) -> None:
    """Searching every key in all others would take hours."""
    path = tmp_path / "regions.json"
    path.write_text("{" + ",".join(f'"{number}":0' for number in [*range(300_000), 299_999]) + "}")
    with pytest.raises(InputError, match=r"the key '299999' occurs more than once"):
        load_regions(path)


def test_files_that_would_fill_the_memory_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "regions.json"
    with path.open("wb") as file:
        file.truncate(20_000_001)
    with pytest.raises(InputError, match=rf"^{path}: is 20000001 bytes large; expected .+ of at most 20000000$"):
        load_regions(path)
