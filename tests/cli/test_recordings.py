"""Recordings whose names and contents Hydra, shells and players make something else of, through the commands."""

import json
import shutil
from collections.abc import Callable, Sequence
from fractions import Fraction
from pathlib import Path
from typing import Any

import av
import numpy as np
import pytest

from geoskill.io.video import VideoFile

Command = Callable[..., Any]
MILLISECOND = Fraction(1, 1000)


def write_video(path: Path, frames: Sequence[np.ndarray], times_s: Sequence[float]) -> Path:
    """Write an MP4 with these time stamps."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with av.open(str(path), "w", format="mp4") as container:
        stream = container.add_stream("libx264", rate=10, options={"crf": "0", "bf": "0"})
        assert isinstance(stream, av.VideoStream)
        stream.height, stream.width = frames[0].shape[:2]
        stream.pix_fmt = "yuv444p"
        stream.codec_context.time_base = MILLISECOND
        for image, time_s in zip(frames, times_s, strict=True):
            frame = av.VideoFrame.from_ndarray(np.ascontiguousarray(image), format="rgb24")
            frame.pts, frame.time_base = round(1000 * time_s), MILLISECOND
            container.mux(stream.encode(frame))
        container.mux(stream.encode(None))
    return path


@pytest.fixture
def working_folder(command: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Where the commands run, so that names need no path."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.slow
@pytest.mark.parametrize("name", ["Bob's müller (1), видео [final].m4v", "lr=0.1/v", "2024_01_05"])
def test_nasty_names(
    command: Command,
    tiny: Sequence[str],
    demonstration_frames: tuple[np.ndarray, ...],
    demonstration_folder: Path,
    working_folder: Path,
    name: str,
) -> None:
    if name.isidentifier() or name[0].isdigit():
        shutil.copytree(demonstration_folder, name)
    else:
        write_video(working_folder / name, demonstration_frames, np.arange(20) / 10)
    labels = {"object": [[1, 1], [9, 1], [9, 9]], "target": [], "hand": []}
    regions = f"labels of {Path(name).name}.json"
    Path(regions).write_text(json.dumps({"image_size": [160, 120], "frames": {"0": labels, "19": labels}}), "utf-8-sig")
    run = f"runs/{Path(name).name}, first"
    settings = [override for override in tiny if not override.startswith("task.path=")]
    trained = command("train", *settings, f"task.path={name}", f"task.regions={regions}", f"hydra.run.dir={run}")
    assert (trained.status, trained.stderr, trained.folder) == (0, "", working_folder / run)

    again = command("train", *settings, f"task.path=[{name},{name}]", f"init_from={run}", "hydra.run.dir=again")
    assert (again.status, again.stderr) == (0, "")
    inferred = command("infer", f"skill={run}", f"video={name}", "hydra.run.dir=inferred", "cache.folder=a, b")
    assert (inferred.status, inferred.stderr) == (0, "")
    assert json.loads((inferred.folder / "metrics.json").read_text())["source"] == name
    assert Path("a, b").is_dir()
    scored = command("evaluate", f"skill={run}", f"video={name}", f"regions={regions}", "hydra.run.dir=scored")
    assert (scored.status, scored.stderr) == (0, "")


@pytest.mark.slow
def test_overlay_has_the_times_of_the_video(
    command: Command, skill: Path, demonstration_frames: tuple[np.ndarray, ...], working_folder: Path
) -> None:
    times = [*np.arange(6) / 30, 1.5, 2.0, *(2.0 + np.arange(1, 13) / 7)]
    write_video(working_folder / "phone.mp4", demonstration_frames, times)
    ended = command("infer", f"skill={skill}", "video=phone.mp4", "hydra.run.dir=run")
    assert (ended.status, ended.stderr) == (0, "")
    shown = [frame.time_s for frame in VideoFile(ended.folder / "overlay.mp4")]
    np.testing.assert_allclose(shown, times, atol=2e-3)


@pytest.mark.slow
def test_episodes_in_one_file(
    command: Command, tiny: Sequence[str], demonstration_frames: tuple[np.ndarray, ...], working_folder: Path
) -> None:
    write_video(working_folder / "both.mp4", demonstration_frames, np.arange(20) / 10)
    settings = [override for override in tiny if not override.startswith("task.path=")]
    parts = ("task.path=both.mp4", "task.start=[0,10f]", "task.end=[0.9,2]", "hydra.run.dir=run")
    ended = command("train", *settings, *parts)
    assert (ended.status, ended.stderr) == (0, "")
    figures = json.loads((ended.folder / "metrics.json").read_text())
    assert (figures["source"], figures["frames"]) == ("both.mp4 (from 0 s, to 0.9 s)", 9)
    shown = [frame.time_s for frame in VideoFile(ended.folder / "overlay.mp4")]
    np.testing.assert_allclose(shown, np.arange(9) / 10, atol=2e-3)


def test_folder_that_is_not_there_is_no_camera(command: Command, skill: Path, working_folder: Path) -> None:
    for name in ("2024_01_05", "20240105", "1e5", "007"):
        ended = command("infer", f"skill={skill}", f"video={name}", "hydra.run.dir=run")
        assert ended.status == 2
        assert ended.stderr.startswith(
            f"error: '{name}' does not exist; expected a video (mp4, mov, avi, webm, mkv or "
        )
