"""Image topics of ROS 2's recordings (rosbag2) in MCAP, raw and compressed.

A bag is a file ``*.mcap``, or a folder of ``metadata.yaml`` and such files. Encodings are those of ROS's
``sensor_msgs/image_encodings.hpp``.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, final

import cv2
import numpy as np
from jaxtyping import UInt8

from geoskill.errors import InputError, missing_extra, shown
from geoskill.io.choice import Choice
from geoskill.io.file_order import in_order
from geoskill.io.frames import Frame, FrameSource, bgr_to_rgb, quiet_opencv, size_text, validate_frame_rate

if TYPE_CHECKING:
    from mcap.reader import McapReader

MAGIC = b"\x89MCAP0\r\n"
SQLITE = b"SQLite format 3\x00"
RAW, COMPRESSED = "sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage"
# Messages from whose times the frame rate is estimated.
MESSAGES_FOR_RATE = 100
# A picture of 8K in colors, or a chunk of megabytes.
MAX_RECORD_BYTES = 256_000_000
NANOSECONDS = 1e-9
# Channels of the stored picture, and its conversion to RGB. OpenCV calls the mosaics by the second row and column.
ENCODINGS: dict[str, tuple[int, int | None]] = {
    "rgb8": (3, None),
    "bgr8": (3, cv2.COLOR_BGR2RGB),
    "rgba8": (4, cv2.COLOR_RGBA2RGB),
    "bgra8": (4, cv2.COLOR_BGRA2RGB),
    "mono8": (1, cv2.COLOR_GRAY2RGB),
    "bayer_rggb8": (1, cv2.COLOR_BayerBG2RGB),
    "bayer_bggr8": (1, cv2.COLOR_BayerRG2RGB),
    "bayer_gbrg8": (1, cv2.COLOR_BayerGR2RGB),
    "bayer_grbg8": (1, cv2.COLOR_BayerGB2RGB),
    "yuv422": (2, cv2.COLOR_YUV2RGB_UYVY),
    "uyvy": (2, cv2.COLOR_YUV2RGB_UYVY),
    "yuv422_yuy2": (2, cv2.COLOR_YUV2RGB_YUY2),
    "yuyv": (2, cv2.COLOR_YUV2RGB_YUY2),
}


@final
class BagTopic(FrameSource):
    """The pictures of one topic, with the times at which they were recorded.

    Args:
        path: the bag.
        choice: the topic, where the bag has several with pictures.
        frame_rate: nominal frames per second; None for that of the first messages.

    Raises:
        InputError: when the bag cannot be read, or the topic is missing or none of it.
    """

    def __init__(self, path: str | Path, choice: Choice, frame_rate: float | None = None) -> None:
        self._path = Path(path)
        self._files = _files(self._path)
        topics: dict[str, str] = {}
        for file in self._files:
            topics |= _image_topics(file)
        self._topic = _chosen(self._path, topics, choice)
        self._is_compressed = topics[self._topic] == COMPRESSED
        self._frame_rate = validate_frame_rate(self._measured_rate() if frame_rate is None else frame_rate)

    @property
    def name(self) -> str:
        """Return the path and the topic."""
        return f"{self._path}, {self._topic}"

    @property
    def frame_rate(self) -> float:
        """Return the nominal frames per second."""
        return self._frame_rate

    def __iter__(self) -> Iterator[Frame]:
        index, start_s, first = 0, 0.0, None
        for file in self._files:
            with _reader(file, self._topic) as reader:
                for _, _, message, decoded in reader.iter_decoded_messages(topics=[self._topic]):
                    where = f"{self.name}: message {index}"
                    image = _decompressed(where, decoded) if self._is_compressed else _picture(where, decoded)
                    first = first or image.shape
                    if image.shape != first:
                        raise InputError(
                            f"{where} is {size_text(image.shape)}; expected {size_text(first)} like others"
                        )
                    time_s = message.log_time * NANOSECONDS
                    start_s = start_s if index else time_s
                    yield Frame(index, time_s - start_s, image)
                    index += 1
        if index == 0:
            raise InputError(f"{self.name}: has no message; expected pictures")

    def _measured_rate(self) -> float:
        times: list[int] = []
        for file in self._files:
            with _reader(file, self._topic) as reader:
                for _, _, message in reader.iter_messages(topics=[self._topic]):
                    times.append(message.log_time)
                    if len(times) == MESSAGES_FOR_RATE:
                        break
        duration_s = (max(times) - min(times)) * NANOSECONDS if times else 0.0
        if duration_s <= 0:
            raise InputError(f"{self.name}: {len(times)} message(s) of one time; expected several pictures")
        return (len(times) - 1) / duration_s


def is_bag(path: Path) -> bool:
    """Return whether a path is a bag's folder, or a file of it."""
    if path.is_dir():
        return (path / "metadata.yaml").is_file() and any(_recordings(path))
    try:
        with path.open("rb") as file:
            begin = file.read(max(len(MAGIC), len(SQLITE)))
    except OSError:
        return False
    return begin.startswith((MAGIC, SQLITE))


def _recordings(folder: Path) -> list[Path]:
    return [*folder.glob("*.mcap"), *folder.glob("*.db3")]


def _files(path: Path) -> list[Path]:
    by_stem = {file.stem: file for file in (_recordings(path) if path.is_dir() else [path])}
    files = [by_stem[stem] for stem in in_order(by_stem)[0]]
    for file in files:
        with file.open("rb") as opened:
            if opened.read(len(SQLITE)) == SQLITE:
                raise InputError(
                    f"{file}: a bag in SQLite; expected MCAP, which `ros2 bag convert -i BAG -o OPTIONS` makes with"
                    " storage_id: mcap in OPTIONS"
                )
    return files


@contextmanager
def _reader(path: Path, topic: str = "") -> "Iterator[McapReader]":
    try:
        from mcap.reader import SeekingReader
        from mcap_ros2.decoder import DecoderFactory
    except ImportError:
        raise missing_extra(str(path), "ros2") from None
    try:
        with path.open("rb") as file:
            yield SeekingReader(
                file,
                validate_crcs=True,
                decoder_factories=[DecoderFactory()],
                record_size_limit=MAX_RECORD_BYTES,
            )
    except InputError:
        raise
    except Exception as error:  # a damaged file leads to any in the packages that read it
        place = f"{path}, {topic}" if topic else str(path)
        reason = " ".join(str(error).split()) or type(error).__name__
        raise InputError(f"{place}: damaged or cut off ({reason}); expected a complete bag") from error


def _image_topics(path: Path) -> dict[str, str]:
    with _reader(path) as reader:
        summary = reader.get_summary()
        if summary is None:
            raise InputError(f"{path}: has no summary, as if it were cut off; expected a complete bag (mcap recover)")
        schemas = {
            channel.topic: summary.schemas[channel.schema_id].name
            for channel in summary.channels.values()
            if channel.schema_id in summary.schemas
        }
    return {topic: name for topic, name in schemas.items() if name in (RAW, COMPRESSED)}


def _chosen(path: Path, topics: dict[str, str], choice: Choice) -> str:
    key, listed = f"{choice.prefix}topic", ", ".join(sorted(topics)) or "none in the bag"
    if choice.topic is not None:
        if choice.topic not in topics:
            raise InputError(f"{key}={choice.topic}: no image topic of {path}; expected one of: {listed}")
        return choice.topic
    if len(topics) != 1:
        raise InputError(f"{path}: has {len(topics)} image topics; expected {key}=TOPIC, one of: {listed}")
    return next(iter(topics))


def _picture(where: str, message: Any) -> UInt8[np.ndarray, "height width 3"]:
    encoding = str(message.encoding)
    if encoding in ("16UC1", "32FC1", "mono16"):
        raise InputError(f"{where} is {encoding}, which is depth or another measurement; expected a topic of pictures")
    if encoding not in ENCODINGS:
        raise InputError(f"{where} has the encoding {shown(encoding)}; expected one of: {', '.join(ENCODINGS)}")
    channels, conversion = ENCODINGS[encoding]
    height, width, step = int(message.height), int(message.width), int(message.step)
    data = np.frombuffer(bytes(message.data), np.uint8)
    if not (height > 0 and width > 0 and step >= width * channels and data.size >= step * height):
        raise InputError(
            f"{where}: {data.size} bytes for {width}x{height} in rows of {step}; expected as many as it says"
        )
    rows = data[: step * height].reshape(height, step)[:, : width * channels]
    stored = np.ascontiguousarray(rows.reshape(height, width, channels) if channels > 1 else rows)
    try:
        return np.asarray(stored if conversion is None else cv2.cvtColor(stored, conversion), np.uint8)
    except cv2.error as error:  # mosaics and half the colors need an even size
        raise InputError(
            f"{where}: {width}x{height} in {encoding} cannot be converted; expected an even size"
        ) from error


def _decompressed(where: str, message: Any) -> UInt8[np.ndarray, "height width 3"]:
    if "compressedDepth" in str(message.format):
        raise InputError(f"{where} is depth; expected a topic of pictures")
    data = np.frombuffer(bytes(message.data), np.uint8)
    try:
        with quiet_opencv():
            image = cv2.imdecode(data, cv2.IMREAD_COLOR) if data.size else None
    except cv2.error:
        image = None
    if image is None:
        raise InputError(f"{where}, {shown(message.format)}, cannot be read; expected JPEG or PNG")
    return bgr_to_rgb(image)
