"""Writer of small LeRobot data sets, as versions 2.1 and 3.0 are documented."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import av
import cv2
import numpy as np
import pyarrow as pa
from pyarrow import parquet

FPS = 10
FRONT, WRIST = "observation.images.front", "observation.images.wrist"


def gray_episodes(lengths: Sequence[int]) -> list[list[np.ndarray]]:
    """Frame ``f`` of episode ``e`` is gray of 40 * e + 5 * f everywhere."""
    return [
        [np.full((64, 96, 3), 40 * episode + 5 * frame, np.uint8) for frame in range(length)]
        for episode, length in enumerate(lengths)
    ]


def write_video(path: Path, frames: Sequence[np.ndarray], codec: str = "libsvtav1") -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    options = {"g": "2", "crf": "20", "preset": "12", "svtav1-params": "lp=1"} if codec == "libsvtav1" else {"g": "2"}
    with av.open(str(path), "w") as container:
        stream = container.add_stream(codec, rate=FPS, options=options)
        assert isinstance(stream, av.VideoStream)
        stream.height, stream.width, stream.pix_fmt = *frames[0].shape[:2], "yuv420p"
        for image in frames:
            container.mux(stream.encode(av.VideoFrame.from_ndarray(np.ascontiguousarray(image), format="rgb24")))
        container.mux(stream.encode(None))


def write_info(folder: Path, version: str, count: int, features: dict[str, Any], **more: Any) -> None:
    (folder / "meta").mkdir(parents=True, exist_ok=True)
    info = {
        "codebase_version": version,
        "robot_type": "so100",
        "total_episodes": count,
        "chunks_size": 1000,
        "fps": FPS,
    }
    (folder / "meta" / "info.json").write_text(json.dumps({**info, "features": features, **more}))


def video_feature(*, depth: bool = False) -> dict[str, Any]:
    return {"dtype": "video", "shape": [64, 96, 3], "info": {"video.codec": "av1", "video.is_depth_map": depth}}


FEATURES = {
    FRONT: video_feature(),
    "observation.images.depth": video_feature(depth=True),
    "action": {"dtype": "float32"},
}


def write_v2(folder: Path, episodes: Sequence[Sequence[np.ndarray]], version: str = "v2.1") -> Path:
    write_info(folder, version, len(episodes), FEATURES)
    lines = [{"episode_index": n, "tasks": ["stack"], "length": len(own)} for n, own in enumerate(episodes)]
    (folder / "meta" / "episodes.jsonl").write_text("".join(json.dumps(line) + "\n" for line in lines))
    for number, frames in enumerate(episodes):
        write_video(folder / "videos" / "chunk-000" / FRONT / f"episode_{number:06d}.mp4", frames, "libx264")
    return folder


def write_v3(folder: Path, episodes: Sequence[Sequence[np.ndarray]], **features: dict[str, Any]) -> Path:
    """All episodes are in one video."""
    write_info(folder, "v3.0", len(episodes), {**FEATURES, **features})
    ends = np.cumsum([len(own) for own in episodes])
    starts = [0, *ends[:-1]]
    rows = {
        "episode_index": list(range(len(episodes))),
        "length": [len(own) for own in episodes],
        "data/chunk_index": [0] * len(episodes),
        "data/file_index": [0] * len(episodes),
        f"videos/{FRONT}/chunk_index": [0] * len(episodes),
        f"videos/{FRONT}/file_index": [0] * len(episodes),
        f"videos/{FRONT}/from_timestamp": [float(start) / FPS for start in starts],
        f"videos/{FRONT}/to_timestamp": [float(end) / FPS for end in ends],
    }
    path = folder / "meta" / "episodes" / "chunk-000" / "file-000.parquet"
    path.parent.mkdir(parents=True)
    parquet.write_table(pa.table(rows), path)
    write_video(folder / "videos" / FRONT / "chunk-000" / "file-000.mp4", [frame for own in episodes for frame in own])
    return folder


def write_pictures_v3(folder: Path, episodes: Sequence[Sequence[np.ndarray]]) -> Path:
    """The pictures are in the table of the data."""
    write_v3(folder, episodes, **{WRIST: {"dtype": "image", "shape": [64, 96, 3]}})
    encoded = [{"bytes": cv2.imencode(".png", frame)[1].tobytes(), "path": None} for own in episodes for frame in own]
    numbers = [number for number, own in enumerate(episodes) for _ in own]
    path = folder / "data" / "chunk-000" / "file-000.parquet"
    path.parent.mkdir(parents=True)
    parquet.write_table(pa.table({"episode_index": numbers, WRIST: encoded}), path)
    return folder
