"""Folders with depth as RealSense, TUM and HRT1 write them, and what is said of those that do not fit."""

import re
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from geoskill.errors import InputError
from geoskill.geometry.depth_camera import DepthCamera
from geoskill.geometry.depth_registration import registered
from geoskill.io.camera_file import read_camera_file
from geoskill.io.depth_folder import DepthFolder
from geoskill.io.image_folder import ImageFolder
from geoskill.io.sources import open_frames

HEIGHT, WIDTH = 24, 32
CAMERA = "fx: 30.0\nfy: 31.0\ncx: 15.5\ncy: 11.5\n"
PLAIN = DepthCamera(30.0, 31.0, 15.5, 11.5)


def depth_values(number: int, factor: float = 1000.0) -> np.ndarray:
    """A slope from 0.5 m on the left, deeper by 10 cm with every picture, with a hole."""
    meters = 0.5 + 0.1 * number + np.linspace(0, 0.2, WIDTH)[None].repeat(HEIGHT, axis=0)
    values = np.round(meters * factor).astype(np.uint16)
    values[3, 4] = 0
    return values


def write(
    folder: Path,
    pictures: list[str],
    depths: list[str],
    *,
    camera: tuple[str, str] | None = ("camera.yaml", CAMERA),
    factor: float = 1000.0,
) -> Path:
    """Write pictures and depth by their names in the folder, and the intrinsics."""
    for number, name in enumerate(pictures):
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        assert cv2.imwrite(str(path), np.full((HEIGHT, WIDTH, 3), 10 * number, np.uint8))
    for number, name in enumerate(depths):
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        assert cv2.imwrite(str(path), depth_values(number, factor))
    if camera is not None:
        (folder / camera[0]).write_text(camera[1])
    return folder


LAYOUTS = {
    "beside": (["1.png", "2.png", "10.png"], ["depth/1.png", "depth/2.png", "depth/10.png"], {}),
    "realsense": (
        [f"color/Color_{number}.png" for number in (1, 2, 10)],
        [f"depth/Depth_{number}.png" for number in (1, 2, 10)],
        {},
    ),
    "tum": (
        ["rgb/1305031102.175304.png", "rgb/1305031102.211214.png", "rgb/1305031102.243211.png"],
        ["depth/1305031102.160407.png", "depth/1305031102.226738.png", "depth/1305031102.262886.png"],
        {
            "camera": (
                "camera.yaml",
                "%YAML:1.0\n"
                + re.sub("^", "Camera.", CAMERA, flags=re.M).removesuffix("Camera.")
                + "DepthMapFactor: 5000.0\n",
            ),
            "factor": 5000.0,
        },
    ),
    "hrt1": (
        [f"rgb/00000{number}.jpg" for number in range(3)],
        [f"depth/00000{number}.png" for number in range(3)],
        {"camera": ("cam_K.txt", "30.0 0.0 15.5\n0.0 31.0 11.5\n0.0 0.0 1.0\n")},
    ),
}


@pytest.mark.parametrize("layout", LAYOUTS)
def test_layout_is_read_in_meters_with_its_intrinsics(layout: str, tmp_path: Path) -> None:
    pictures, depths, options = LAYOUTS[layout]
    source = open_frames(write(tmp_path, pictures, depths, **options))
    assert isinstance(source, DepthFolder)
    frames = list(source)
    assert [round(float(frame.image.mean()) / 10) for frame in frames] == [0, 1, 2]
    for number, frame in enumerate(frames):
        assert frame.depth_camera == PLAIN
        np.testing.assert_allclose(frame.depth_m[0], 0.5 + 0.1 * number + np.linspace(0, 0.2, WIDTH), atol=6e-4)
        assert np.isnan(frame.depth_m[3, 4])
        assert np.isnan(frame.depth_m).sum() == 1


def test_arrays_are_meters_or_as_png(tmp_path: Path) -> None:
    write(tmp_path, ["0.png", "1.png"], [])
    (tmp_path / "depth").mkdir()
    np.savez(tmp_path / "depth" / "0.npz", depth_values(0))
    meters = (depth_values(1) / 1000).astype(np.float32)
    np.savez(tmp_path / "depth" / "1.npz", depth=meters)
    first, second = open_frames(tmp_path)
    np.testing.assert_allclose(second.depth_m[0] - first.depth_m[0], 0.1, atol=1e-6)


OPENCV = """%YAML:1.0
---
image_width: 640
camera_matrix: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [ 30., 0., 15.5, 0., 31., 11.5, 0., 0., 1. ]
"""
ROS = """
header: {frame_id: camera}
height: 24
width: 32
distortion_model: plumb_bob
d: [0.0, 0.0, 0.0, 0.0, 0.0]
k: [30.0, 0.0, 15.5, 0.0, 31.0, 11.5, 0.0, 0.0, 1.0]
"""
FILES = {
    "opencv": OPENCV,
    "ros": ROS,
    "ros calibration": "camera_matrix: {rows: 3, cols: 3, data: [30, 0, 15.5, 0, 31, 11.5, 0, 0, 1]}",
    "rows": "K: [[30, 0, 15.5], [0, 31, 11.5], [0, 0, 1]]",
    "tum": CAMERA,
}


@pytest.mark.parametrize("name", FILES)
def test_intrinsics_are_read_as_others_write_them(name: str, tmp_path: Path) -> None:
    path = tmp_path / "camera.yaml"
    path.write_text(FILES[name])
    read = read_camera_file(path)
    assert read.color == PLAIN
    assert read.depth is None
    assert read.depth_factor == 1000.0


def test_opencv_reads_its_own_file_as_we_do(tmp_path: Path) -> None:
    path = tmp_path / "camera.yaml"
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    storage.write("camera_matrix", np.array([[30.0, 0, 15.5], [0, 31, 11.5], [0, 0, 1]]))
    storage.release()
    assert read_camera_file(path).color == PLAIN


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "holds None; expected camera_matrix, K, or fx"),
        ("[1, 2]", r"holds \[1, 2\]; expected"),
        ("a: {b: [", "cannot be read"),
        ("fx: 30", "has fx; expected camera_matrix, K, or fx, fy, cx and cy"),
        ("K: [1, 2, 3]", r"K is \[1, 2, 3\]; expected 9 numbers"),
        ("fx: a\nfy: 1\ncx: 1\ncy: 1", "fx is 'a'; expected 1 number"),
        ("fx: -3\nfy: 1\ncx: 1\ncy: 1", "expected focal lengths above 0"),
        (CAMERA + "depth_factor: 0", "depth_factor=0; expected the value of a pixel at one meter"),
        (CAMERA + "depth: 3", "depth is 3; expected"),
        (CAMERA + "depth: {fx: 1, fy: 1, cx: 1, cy: 1}\ndepth_to_color: [1]", "depth_to_color is .*; expected 16 num"),
        (
            CAMERA + "depth: {fx: 1, fy: 1, cx: 1, cy: 1}\ndepth_to_color: " + str([0.0] * 16),
            "depth_to_color is no rotation",
        ),
    ],
)
def test_file_that_tells_no_intrinsics_is_named(text: str, message: str, tmp_path: Path) -> None:
    path = tmp_path / "camera.yaml"
    path.write_text(text)
    with pytest.raises(InputError, match=f"^{re.escape(str(path))}: .*{message}"):
        read_camera_file(path)


@given(st.text(max_size=80))
def test_any_text_gives_intrinsics_or_one_line(tmp_path_factory: pytest.TempPathFactory, text: str) -> None:
    path = tmp_path_factory.mktemp("camera") / "camera.yaml"
    path.write_bytes(text.encode("utf-8", "surrogatepass"))
    with pytest.raises(InputError) as caught:
        read_camera_file(path)
    assert "\n" not in str(caught.value)


def missing(folder: Path) -> str:
    (folder / "depth" / "1.png").unlink()
    return (
        r"1 of 3 pictures have no depth, the first is 1\.png; expected a file of its name, or of its number, in depth/"
    )


def none_left(folder: Path) -> str:
    for path in (folder / "depth").iterdir():
        path.unlink()
    return r"depth: holds no depth; expected \.png files of 16 bits, or \.npz files"


def smaller(folder: Path) -> str:
    cv2.imwrite(str(folder / "depth" / "1.png"), depth_values(0)[::2, ::2])
    return r"depth/1\.png: the depth is 16x12 pixels; expected 32x24 like the picture, or the depth's own intrinsics"


def of_eight_bits(folder: Path) -> str:
    cv2.imwrite(str(folder / "depth" / "1.png"), depth_values(0).astype(np.uint8))
    return r"depth/1\.png: is uint8 \[24, 32\]; expected a picture of depth, one channel of 16 bits"


def damaged(folder: Path) -> str:
    (folder / "depth" / "1.png").write_bytes(b"\x89PNG\r\n")
    return r"depth/1\.png: (is damaged|cannot be read .*); expected a picture of depth"


def in_meters(folder: Path) -> str:
    (folder / "camera.yaml").write_text(CAMERA + "depth_factor: 1")
    return r"depth/0\.png: the median depth is 603 m; expected 0\.05 to 20 m \(depth_factor, .* is 1 in camera\.yaml\)"


def in_micrometers(folder: Path) -> str:
    (folder / "camera.yaml").write_text(CAMERA + "depth_factor: 1000000")
    return r"depth/0\.png: the median depth is 0\.000603 m; expected 0\.05 to 20 m"


@pytest.mark.parametrize("spoil", [missing, none_left, smaller, of_eight_bits, damaged, in_meters, in_micrometers])
def test_what_does_not_fit_is_named_in_one_line(spoil: object, tmp_path: Path) -> None:
    names = [f"{number}.png" for number in range(3)]
    folder = write(tmp_path, names, [f"depth/{name}" for name in names])
    message = spoil(folder)
    with pytest.raises(InputError, match=message) as caught:
        list(open_frames(folder))
    assert "\n" not in str(caught.value)


def test_depth_without_intrinsics_is_left_out_and_said(tmp_path: Path) -> None:
    folder = write(tmp_path, ["0.png", "1.png"], ["depth/0.png", "depth/1.png"], camera=None)
    with pytest.warns(UserWarning, match=r"depth/ is left out; expected intrinsics in camera\.yaml beside it"):
        source = open_frames(folder)
    assert isinstance(source, ImageFolder)


def test_depth_of_a_camera_beside_is_aligned(tmp_path: Path) -> None:
    """The depth camera sees a wall 1 m away, and a plate 0.5 m away, from 5 cm to the left."""
    camera = DepthCamera(60.0, 60.0, 31.5, 23.5)
    depth_m = np.full((48, 64), 1.0, np.float32)
    depth_m[20:28, 30:40] = 0.5
    shift = np.eye(4)
    shift[0, 3] = -0.05
    aligned = registered(depth_m, camera, PLAIN, shift, (WIDTH, HEIGHT))
    # The plate's first column is at x = (30 - 31.5) / 60 * 0.5 - 0.05 m, which is column 15.5 - 30 * 0.125.
    (columns,) = np.nonzero(aligned[11] == np.float32(0.5))
    assert columns.min() == round(15.5 - 30 * 0.125)
    assert np.isin(np.round(aligned[np.isfinite(aligned)], 3), [0.5, 1.0]).all()
    write(tmp_path, ["0.png"], [])
    (tmp_path / "depth").mkdir()
    cv2.imwrite(str(tmp_path / "depth" / "0.png"), (1000 * depth_m).astype(np.uint16))
    own = "depth: {fx: 60, fy: 60, cx: 31.5, cy: 23.5}\n"
    (tmp_path / "camera.yaml").write_text(CAMERA + own + f"depth_to_color: {shift.ravel().tolist()}\n")
    (frame,) = open_frames(tmp_path)
    np.testing.assert_allclose(frame.depth_m, aligned, atol=1e-6)
