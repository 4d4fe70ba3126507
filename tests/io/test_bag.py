"""Bags of ROS 2, written by the package of the format."""

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from mcap_ros2.writer import Writer

from geoskill.errors import InputError
from geoskill.io.bag import ENCODINGS, BagTopic
from geoskill.io.choice import Choice
from geoskill.io.sources import open_frames

HEADER = """
================================================================================
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
================================================================================
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
"""
IMAGE = f"""std_msgs/Header header
uint32 height
uint32 width
string encoding
uint8 is_bigendian
uint32 step
uint8[] data
{HEADER}"""
COMPRESSED = f"""std_msgs/Header header
string format
uint8[] data
{HEADER}"""
STAMP = {"stamp": {"sec": 1, "nanosec": 0}, "frame_id": "camera"}
# Patches of 8 x 8 pixels, in which every mosaic has all of its colors.
COLORS = np.kron(np.random.default_rng(0).integers(0, 256, (4, 6, 3)), np.ones((8, 8, 1))).astype(np.uint8)


def raw(picture: np.ndarray, encoding: str, **changed: Any) -> dict[str, Any]:
    height, width = picture.shape[:2]
    rows = picture.reshape(height, -1)
    padded = np.pad(rows, ((0, 0), (0, 5)))  # drivers may align rows
    own = {"height": height, "width": width, "encoding": encoding, "is_bigendian": 0, "step": padded.shape[1]}
    return {"header": STAMP, **own, "data": padded.tobytes(), **changed}


def compressed(picture: np.ndarray, kind: str = "png") -> dict[str, Any]:
    data = cv2.imencode(f".{kind}", picture[:, :, ::-1])[1].tobytes()
    return {"header": STAMP, "format": f"bgr8; {kind} compressed bgr8", "data": data}


def write_bag(path: Path, topics: dict[str, Sequence[dict[str, Any]]], first: int = 0) -> Path:
    """Write messages, ten a second, at Unix times."""
    with path.open("wb") as file:
        writer = Writer(file)
        schemas = {
            "data": writer.register_msgdef("sensor_msgs/msg/Image", IMAGE),
            "format": writer.register_msgdef("sensor_msgs/msg/CompressedImage", COMPRESSED),
        }
        for topic, messages in topics.items():
            for number, message in enumerate(messages, start=first):
                schema = schemas["format" if "format" in message else "data"]
                time_ns = 1_700_000_000_000_000_000 + 100_000_000 * number
                writer.write_message(topic, schema, message, time_ns, time_ns)
        writer.finish()
    return path


def mosaic(picture: np.ndarray, pattern: str) -> np.ndarray:
    """The pixels that a sensor with this pattern (rows of two) has of a picture."""
    channels = np.array(["rgb".index(letter) for letter in pattern]).reshape(2, 2)
    rows, columns = np.indices(picture.shape[:2])
    return np.take_along_axis(picture, channels[rows % 2, columns % 2][:, :, None], 2)[:, :, 0]


def stored(encoding: str) -> np.ndarray:
    if encoding.startswith("bayer"):
        return mosaic(COLORS, encoding[6:10])
    if encoding.startswith(("yu", "uy")):
        kind = cv2.COLOR_RGB2YUV_YUY2 if encoding in ("yuyv", "yuv422_yuy2") else cv2.COLOR_RGB2YUV_UYVY
        return np.asarray(cv2.cvtColor(COLORS, kind))
    alpha = np.full((*COLORS.shape[:2], 1), 9, np.uint8)
    return {
        "rgb8": COLORS,
        "bgr8": COLORS[:, :, ::-1],
        "rgba8": np.concatenate([COLORS, alpha], 2),
        "bgra8": np.concatenate([COLORS[:, :, ::-1], alpha], 2),
        "mono8": COLORS[:, :, 1],
    }[encoding]


@pytest.mark.parametrize("encoding", ENCODINGS)
def test_raw_pictures(tmp_path: Path, encoding: str) -> None:
    path = write_bag(tmp_path / "a.mcap", {"/image": [raw(stored(encoding), encoding)] * 3})
    frames = list(open_frames(path))
    assert [frame.index for frame in frames] == [0, 1, 2]
    np.testing.assert_allclose([frame.time_s for frame in frames], [0.0, 0.1, 0.2], atol=1e-6)
    expected = np.repeat(COLORS[:, :, 1:2], 3, axis=2) if encoding == "mono8" else COLORS
    inside = np.s_[3::8, 3::8] if encoding.startswith(("bayer", "yu", "uy")) else np.s_[:]  # away from edges
    tolerance = 3 if encoding.startswith(("bayer", "yu", "uy")) else 0
    np.testing.assert_allclose(frames[2].image[inside].astype(int), expected[inside].astype(int), atol=tolerance)


def test_compressed_pictures_and_several_topics(tmp_path: Path) -> None:
    topics = {
        "/left/image/compressed": [compressed(COLORS)] * 4,
        "/right/image": [raw(COLORS // 2, "rgb8")] * 4,
    }
    path = write_bag(tmp_path / "a.mcap", topics)
    with pytest.raises(InputError, match=r"has 2 image topics; expected topic=TOPIC, one of: /left/image/c"):
        open_frames(path)
    with pytest.raises(InputError, match=r"^task\.topic=/x: no image topic of .*; expected one of: /left/"):
        open_frames(path, choice=Choice(topic="/x", prefix="task."))
    with pytest.raises(InputError, match="is not a LeRobot data set"):
        open_frames(path, choice=Choice(episode=0))
    source = open_frames(path, choice=Choice(topic="/left/image/compressed"))
    assert isinstance(source, BagTopic)
    assert source.frame_rate == pytest.approx(10.0)
    assert source.name == f"{path}, /left/image/compressed"
    np.testing.assert_array_equal(list(source)[3].image, COLORS)
    np.testing.assert_array_equal(next(iter(open_frames(path, 5, Choice(topic="/right/image")))).image, COLORS // 2)


def test_folder_of_split_recordings(tmp_path: Path) -> None:
    (tmp_path / "metadata.yaml").write_text("rosbag2_bagfile_information: {}")
    for number in (0, 2, 10):  # by number, not by letter
        write_bag(
            tmp_path / f"bag_{number}.mcap", {"/image": [raw(COLORS[:, :, 0] // 16 + number, "mono8")] * 2}, number
        )
    frames = list(open_frames(tmp_path))
    np.testing.assert_allclose([frame.time_s for frame in frames], [0, 0.1, 0.2, 0.3, 1.0, 1.1], atol=1e-6)
    assert [int(frame.image[0, 0, 0]) - int(COLORS[0, 0, 0]) // 16 for frame in frames] == [0, 0, 2, 2, 10, 10]


@pytest.mark.parametrize(
    ("message", "expected"),
    [
        (raw(COLORS[:, :, 0], "16UC1"), "message 0 is 16UC1, which is depth"),
        (raw(COLORS, "rgb16"), "message 0 has the encoding 'rgb16'; expected one of: rgb8, bgr8"),
        (raw(COLORS, "rgb8", step=10), "bytes for 48x32 in rows of 10"),
        (raw(COLORS, "rgb8", data=b"abc"), "3 bytes for 48x32"),
        (raw(COLORS, "rgb8", height=0), "for 48x0"),
        ({**compressed(COLORS), "data": b"abc"}, "message 0, 'bgr8; png compressed bgr8', cannot be read"),
        ({**compressed(COLORS), "format": "16UC1; compressedDepth png"}, "message 0 is depth"),
    ],
)
def test_messages_that_are_refused(tmp_path: Path, message: dict[str, Any], expected: str) -> None:
    path = write_bag(tmp_path / "a.mcap", {"/image": [message] * 2})
    with pytest.raises(InputError, match=expected):
        list(open_frames(path))


def test_sizes_that_change(tmp_path: Path) -> None:
    path = write_bag(tmp_path / "a.mcap", {"/image": [raw(COLORS, "rgb8"), raw(COLORS[:8], "rgb8")]})
    with pytest.raises(InputError, match="message 1 is 48x8; expected 48x32"):
        list(open_frames(path))


def test_bags_that_are_refused(tmp_path: Path) -> None:
    path = write_bag(tmp_path / "a.mcap", {"/image": [raw(COLORS, "rgb8")]})
    with pytest.raises(InputError, match=r"1 message\(s\) of one time; expected several pictures"):
        open_frames(path)
    path = write_bag(path, {"/image": [raw(COLORS, "rgb8")] * 20})
    content = path.read_bytes()
    path.write_bytes(content[: len(content) // 2])
    with pytest.raises(InputError, match=r"a\.mcap: .*; expected a complete bag"):
        open_frames(path)
    middle = content.index(b"rgb8") if b"rgb8" in content else 400
    path.write_bytes(content[:middle] + bytes(200) + content[middle + 200 :])
    with pytest.raises(InputError, match=r"damaged or cut off .*; expected a complete bag"):
        list(open_frames(path))
    write_bag(path, {})
    with pytest.raises(InputError, match=r"has 0 image topics; expected topic=TOPIC, one of: none in the bag"):
        open_frames(path)
    old = tmp_path / "old.db3"
    old.write_bytes(b"SQLite format 3\0" + bytes(100))
    with pytest.raises(InputError, match=r"old\.db3: a bag in SQLite; expected MCAP"):
        open_frames(old)


def test_package_that_is_not_installed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = write_bag(tmp_path / "a.mcap", {"/image": [raw(COLORS, "rgb8")] * 2})
    monkeypatch.setitem(sys.modules, "mcap.reader", None)
    with pytest.raises(InputError, match=r"expected pip install 'geoskill\[ros2\]'$"):
        open_frames(path)
