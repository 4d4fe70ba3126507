"""Episodes of a LeRobot data set in a local folder, versions 2.0, 2.1 and 3.0, without the package of that name.

Version 2 has a video of each episode and camera, version 3 has many episodes in one video, and says in
``meta/episodes/*/*.parquet`` from when to when each lasts (https://huggingface.co/docs/lerobot/lerobot-dataset-v3).
Files are looked for where these versions have them by default; the templates of paths in ``info.json`` are not used.
"""

import json
import math
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, final

import av
import cv2
import numpy as np

from geoskill.errors import InputError, missing_extra, shown
from geoskill.io.choice import Choice
from geoskill.io.decoding import decoded_frames, video_stream
from geoskill.io.frames import Frame, FrameSource, bgr_to_rgb, quiet_opencv, size_text, validate_frame_rate
from geoskill.io.text_file import parse_json, read_text, written

INFO = Path("meta") / "info.json"
EXPECTED = "a LeRobot data set's info.json"
VERSION = re.compile(r"v?(2\.[01]|3\.0)(?:\.[0-9]+)?")
# What may be part of a path.
CAMERA = re.compile(r"\w[\w.-]*")
MAX_LISTED = 10


@final
@dataclass(frozen=True)
class Segment:
    """Where an episode is.

    Attributes:
        video: path of its video; None where pictures are in the table.
        start_s: its first frame's time in the video.
        length: number of its frames.
        table: path of the table of its frames.
    """

    video: Path | None
    start_s: float
    length: int
    table: Path


@final
class LeRobotEpisode(FrameSource):
    """The frames of one camera in one episode.

    Args:
        folder: of the data set.
        choice: the episode, and the camera where there are several.
        frame_rate: nominal frames per second; None for that of the data set.

    Raises:
        InputError: when the data set is of another version or damaged, the choice is missing or none of it, or its
            files are not there.
    """

    def __init__(self, folder: str | Path, choice: Choice, frame_rate: float | None = None) -> None:
        self._folder = Path(folder)
        info = parse_json(self._folder / INFO, read_text(self._folder / INFO, EXPECTED), EXPECTED)
        version = VERSION.fullmatch(str(info.get("codebase_version")))
        if version is None:
            raise InputError(
                f"{folder}: is a LeRobot data set of version {written(info.get('codebase_version'))}; expected 2.0, 2.1"
                " or 3.0"
            )
        rate = info.get("fps")
        if not isinstance(rate, int | float) or isinstance(rate, bool):
            raise InputError(f"{self._folder / INFO}: fps is {written(rate)}; expected frames per second")
        self._frame_rate = validate_frame_rate(rate if frame_rate is None else frame_rate)
        self._stored_rate = validate_frame_rate(rate)
        self._camera = _camera(self._folder, info, choice)
        self._episode = _episode(self._folder, info, choice)
        is_video = info["features"][self._camera].get("dtype") == "video"
        segment_of = _located_v3 if version[1] == "3.0" else _located_v2
        self._segment = segment_of(self._folder, info, self._camera if is_video else None, self._episode)
        needed = self._segment.video or self._segment.table
        if not needed.is_file():
            raise InputError(f"{needed}: no such file; expected the frames of episode {self._episode}")

    @property
    def name(self) -> str:
        """Return folder, episode and camera."""
        return f"{self._folder}, episode {self._episode}, {self._camera}"

    @property
    def frame_rate(self) -> float:
        """Return the nominal frames per second."""
        return self._frame_rate

    def __iter__(self) -> Iterator[Frame]:
        frames = self._decoded() if self._segment.video is not None else self._pictures()
        count = 0
        for count, frame in enumerate(frames, start=1):
            yield frame
            if count == self._segment.length:
                return
        raise InputError(f"{self.name}: has {count} frames; expected {self._segment.length}, as its data set says")

    def _decoded(self) -> Iterator[Frame]:
        path, half_s = self._segment.video, 0.5 / self._stored_rate
        assert path is not None
        try:
            with av.open(str(path.absolute()), metadata_errors="replace") as container:
                stream = video_stream(container, self.name)
                assert stream.time_base is not None
                # Half a frame earlier, for times are rounded; to the key frame before that.
                begin_s = max(0.0, self._segment.start_s - half_s)
                container.seek(int(begin_s / stream.time_base), stream=stream, backward=True)
                index = 0
                for frame in decoded_frames(container, self.name, self._stored_rate, whole=False, start_s=0.0):
                    if frame.time_s >= begin_s:
                        yield Frame(index, max(0.0, frame.time_s - self._segment.start_s), frame.image)
                        index += 1
        except av.error.FFmpegError as error:
            raise InputError(f"{path}: not readable ({error.strerror}); expected a video") from error

    def _pictures(self) -> Iterator[Frame]:
        where, first = self._segment.table, None
        rows = _rows(where, [self._camera], [("episode_index", "==", self._episode)])
        for index, row in enumerate(rows):
            stored = row[self._camera]
            data = stored.get("bytes") if isinstance(stored, dict) else None
            if not isinstance(data, bytes) or not data:
                raise InputError(f"{where}: {self._camera} of frame {index} is no picture; expected its bytes")
            with quiet_opencv():
                image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)
            if image is None:
                raise InputError(f"{where}: {self._camera} of frame {index} cannot be read; expected PNG or JPEG")
            first = first or image.shape
            if image.shape != first:
                raise InputError(f"{where}: frame {index} is {size_text(image.shape)}; expected {size_text(first)}")
            yield Frame(index, index / self._stored_rate, bgr_to_rgb(image))


def is_lerobot(folder: Path) -> bool:
    """Return whether a folder is that of a LeRobot data set."""
    return (folder / INFO).is_file()


def _camera(folder: Path, info: Mapping[str, Any], choice: Choice) -> str:
    features = info.get("features")
    if not isinstance(features, dict) or not all(isinstance(own, dict) for own in features.values()):
        raise InputError(f"{folder / INFO}: features is {written(features)}; expected what a frame consists of")
    cameras = [name for name, own in features.items() if own.get("dtype") in ("video", "image") and not _is_depth(own)]
    listed = ", ".join(shown(name)[1:-1] for name in cameras[:MAX_LISTED]) or "none in the data set"
    key = f"{choice.prefix}camera"
    if choice.camera is None and len(cameras) == 1:
        camera = str(cameras[0])
    elif choice.camera is None:
        raise InputError(f"{folder}: has {len(cameras)} cameras; expected {key}=NAME, one of: {listed}")
    else:
        camera = choice.camera
    if camera not in cameras:
        raise InputError(f"{key}={camera}: no camera of {folder}; expected one of: {listed}")
    if not CAMERA.fullmatch(camera):
        raise InputError(f"{folder / INFO}: the camera {shown(camera)} cannot be part of a path; expected letters")
    return camera


def _is_depth(feature: Mapping[str, Any]) -> bool:
    details = [feature.get(key) for key in ("info", "video_info")]
    keys = "is_depth_map", "video.is_depth_map"
    return any(isinstance(own, dict) and own.get(key) is True for own in details for key in keys)


def _episode(folder: Path, info: Mapping[str, Any], choice: Choice) -> int:
    count, key = info.get("total_episodes"), f"{choice.prefix}episode"
    if not isinstance(count, int) or isinstance(count, bool) or count < 1:
        raise InputError(f"{folder / INFO}: total_episodes is {written(count)}; expected at least 1")
    if choice.episode is None and count > 1:
        raise InputError(f"{folder}: has {count} episodes; expected {key}=NUMBER, from 0 to {count - 1}")
    episode = choice.episode or 0
    if not 0 <= episode < count:
        raise InputError(f"{key}={episode}: {folder} has {count} episodes; expected a number from 0 to {count - 1}")
    return episode


def _located_v2(folder: Path, info: Mapping[str, Any], camera: str | None, episode: int) -> Segment:
    path = folder / "meta" / "episodes.jsonl"
    length = None
    for line in read_text(path, "the episodes of a LeRobot data set").splitlines():
        try:
            entry = json.loads(line)
        except (ValueError, RecursionError) as error:
            raise InputError(f"{path}: not valid JSON ({error}); expected an episode in each line") from None
        if isinstance(entry, dict) and entry.get("episode_index") == episode:
            length = entry.get("length")
    chunk = episode // _whole(folder / INFO, "chunks_size", info.get("chunks_size", 1000), at_least=1)
    name = f"episode_{episode:06d}"
    return Segment(
        None if camera is None else folder / "videos" / f"chunk-{chunk:03d}" / camera / f"{name}.mp4",
        0.0,
        _whole(path, f"length of episode {episode}", length, at_least=1),
        folder / "data" / f"chunk-{chunk:03d}" / f"{name}.parquet",
    )


def _located_v3(folder: Path, info: Mapping[str, Any], camera: str | None, episode: int) -> Segment:
    keys = ["episode_index", "length", "data/chunk_index", "data/file_index"]
    own = [f"videos/{camera}/{key}" for key in ("chunk_index", "file_index", "from_timestamp")] if camera else []
    for path in sorted((folder / "meta" / "episodes").glob("*/*.parquet")):
        for row in _rows(path, keys + own, [("episode_index", "==", episode)]):
            chunk, file = (_whole(path, key, row[key], at_least=0) for key in keys[2:])
            table = folder / "data" / f"chunk-{chunk:03d}" / f"file-{file:03d}.parquet"
            length = _whole(path, "length", row["length"], at_least=1)
            if camera is None:
                return Segment(None, 0.0, length, table)
            chunk, file = (_whole(path, key, row[key], at_least=0) for key in own[:2])
            start_s = row[own[2]]
            if not isinstance(start_s, float) or not math.isfinite(start_s) or not 0 <= start_s < 1e9:
                raise InputError(f"{path}: {own[2]} is {shown(start_s)}; expected seconds")
            video = folder / "videos" / camera / f"chunk-{chunk:03d}" / f"file-{file:03d}.mp4"
            return Segment(video, start_s, length, table)
    raise InputError(f"{folder / 'meta' / 'episodes'}: has no episode {episode}; expected all of the data set")


def _whole(path: Path, key: str, value: Any, at_least: int) -> int:
    if not isinstance(value, int) or isinstance(value, bool) or not at_least <= value < 10**9:
        raise InputError(f"{path}: {key} is {shown(value)}; expected a whole number of at least {at_least}")
    return value


def _rows(path: Path, columns: list[str], filters: list[tuple[str, str, int]]) -> list[dict[str, Any]]:
    """Return the rows of a table that pass the filters.

    Raises:
        InputError: when it cannot be read or lacks a column, or the package that reads it is not installed.
    """
    try:
        import pyarrow
        from pyarrow import parquet
    except ImportError:
        raise missing_extra(str(path), "datasets") from None
    try:
        with parquet.ParquetFile(path) as file:
            missing = [column for column in columns if column not in file.schema_arrow.names]
        if missing:
            raise InputError(f"{path}: has no column {shown(missing[0])}; expected a LeRobot data set of version 3.0")
        rows: list[dict[str, Any]] = parquet.read_table(path, columns=columns, filters=filters).to_pylist()
    except (pyarrow.ArrowException, OSError) as error:
        if isinstance(error, InputError):
            raise
        raise InputError(f"{path}: cannot be read ({' '.join(str(error).split())}); expected Parquet") from error
    return rows
