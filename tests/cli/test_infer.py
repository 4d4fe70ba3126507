"""``python infer.py`` on folders and videos."""

import json
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from itertools import count
from pathlib import Path
from typing import Any
from unittest.mock import Mock

import av
import cv2
import numpy as np
import pytest
import yaml

from geoskill.cli.reporting import write_inference
from geoskill.errors import InputError
from geoskill.io.camera import Camera
from geoskill.io.frames import Frame, FrameSource
from geoskill.io.image_folder import ImageFolder
from geoskill.skill.association import InferenceResult
from geoskill.skill.skill import Skill

Command = Callable[..., Any]

ROOT = Path(__file__).resolve().parents[2]


def associations(folder: Path) -> list[dict[str, Any]]:
    return [json.loads(line) for line in (folder / "associations.jsonl").read_text(encoding="utf-8").splitlines()]


def write_video(path: Path, frames: tuple[np.ndarray, ...], rate: int = 10) -> Path:
    with av.open(str(path), "w") as container:
        stream = container.add_stream("libx264", rate=rate, options={"crf": "0"})
        stream.height, stream.width = frames[0].shape[:2]
        stream.pix_fmt = "yuv444p"
        for image in frames:
            container.mux(stream.encode(av.VideoFrame.from_ndarray(np.ascontiguousarray(image), format="rgb24")))
        container.mux(stream.encode(None))
    return path


def decoded(path: Path) -> np.ndarray:
    with av.open(str(path)) as container:
        return np.stack([frame.to_ndarray(format="rgb24").astype(np.float32) for frame in container.decode(video=0)])


@pytest.mark.slow
def test_infer_does_not_import_lightning(
    environment: dict[str, str], skill: Path, demonstration_folder: Path, tmp_path: Path
) -> None:
    """It takes two seconds, and only training needs it."""
    arguments = ["infer.py", f"skill={skill}", f"video={demonstration_folder}", f"hydra.run.dir={tmp_path}"]
    program = (
        f"import sys, runpy; sys.argv = {arguments}; runpy.run_path('infer.py', run_name='__main__')\n"
        "print('lightning' in sys.modules, 'torch_geometric' in sys.modules)"
    )
    ended = subprocess.run(
        [sys.executable, "-c", program], cwd=ROOT, env=environment, capture_output=True, text=True, check=True
    )
    assert ended.stdout.splitlines()[-2:] == [str(tmp_path), "False True"]


@pytest.mark.slow
def test_demonstration_gives_the_associations_of_training(
    command: Command, skill: Path, trained: Any, demonstration_folder: Path, tmp_path: Path
) -> None:
    source = f"video={demonstration_folder}"
    ended = command("infer", f"skill={skill}", source, "inference.abstain=0", f"hydra.run.dir={tmp_path}")
    assert (ended.status, ended.folder) == (0, tmp_path), ended.stderr
    assert ended.stderr == ""
    assert associations(tmp_path) == associations(trained.folder)
    assert (tmp_path / "skill.yaml").read_bytes() == (trained.folder / "skill.yaml").read_bytes()
    # The encoder may part the bits among frames differently on a busy machine; the pictures are the same.
    overlays = [decoded(folder / "overlay.mp4") for folder in (tmp_path, trained.folder)]
    assert overlays[0].shape == overlays[1].shape
    assert np.abs(overlays[0] - overlays[1]).mean() < 1
    assert json.loads((tmp_path / "metrics.json").read_text())["frames"] == 20


@pytest.mark.slow
def test_abstaining(command: Command, skill: Path, demonstration_folder: Path, tmp_path: Path) -> None:
    source = [f"skill={skill}", f"video={demonstration_folder}", f"hydra.run.dir={tmp_path}"]
    ended = command("infer", *source, "inference.abstain=1")
    assert (ended.status, ended.stderr) == (0, "")
    lines = associations(tmp_path)
    assert [(line["frame"], line["rank"]) for line in lines] == [(frame, 0) for frame in range(20)]
    said = "no association visible: the selected one has a confidence of"
    assert all(line["reason"].startswith(said) for line in lines)
    assert json.loads((tmp_path / "metrics.json").read_text())["frames_with_association"] == 0


def test_video_file(
    command: Command, skill: Path, demonstration_frames: tuple[np.ndarray, ...], tmp_path: Path
) -> None:
    black = np.zeros_like(demonstration_frames[0])
    path = write_video(tmp_path / "robot.mp4", (*demonstration_frames[:4], black, *demonstration_frames[4:6]))
    run = tmp_path / "run"
    ended = command("infer", f"skill={skill}", f"video={path}", "inference.abstain=0", f"hydra.run.dir={run}")
    assert (ended.status, ended.stderr, ended.folder) == (0, "", run)
    lines = associations(run)
    first = [line for line in lines if line["rank"] in (0, 1)]
    assert [line["frame"] for line in first] == list(range(7))
    assert [line["rank"] for line in first] == [1, 1, 1, 1, 0, 1, 1]
    assert [line["time_s"] for line in first] == pytest.approx(np.arange(7) / 10, abs=1e-5)
    figures = json.loads((run / "metrics.json").read_text())
    assert (figures["frames"], figures["frames_with_association"]) == (7, 6)
    assert figures["source"] == str(path)
    assert yaml.safe_load((run / "skill.yaml").read_text())["members"]["p2p_sift"]["frames_with_association"] == 6
    with av.open(str(run / "overlay.mp4")) as container:
        assert container.streams.video[0].codec_context.name == "h264"
        assert float(container.streams.video[0].average_rate or 0) == pytest.approx(10)
        assert sum(1 for _ in container.decode(video=0)) == 7


@pytest.mark.slow
def test_number_of_threads_changes_no_byte(
    script: Command, skill: Path, demonstration_folder: Path, tmp_path: Path
) -> None:
    """Nothing is cached, so that everything is extracted by as many threads as it says."""
    for threads in (1, 3):
        run = [f"threads={threads}", "cache.enabled=false", f"hydra.run.dir={tmp_path / str(threads)}"]
        ended = script("infer", f"skill={skill}", f"video={demonstration_folder}", *run)
        assert (ended.status, ended.stderr) == (0, "")
    for name in ("associations.jsonl", "skill.yaml", "metrics.json"):
        assert (tmp_path / "1" / name).read_bytes() == (tmp_path / "3" / name).read_bytes()
    assert len(associations(tmp_path / "3")) >= 20


def test_camera_is_read_one_frame_ahead_and_released_by_ctrl_c(
    skill: Path, demonstration_frames: tuple[np.ndarray, ...], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    capture = Mock(spec=cv2.VideoCapture)
    capture.get.return_value = 30.0
    capture.read.side_effect = [(True, frame[:, :, ::-1]) for frame in demonstration_frames]
    monkeypatch.setattr(cv2, "VideoCapture", lambda index: capture)
    loaded, used = Skill.load(skill), count()

    def interrupted(*given: Any) -> InferenceResult:
        place = next(used)
        time.sleep(0.2)  # slower than the camera, which could be far ahead by now
        assert capture.read.call_count == place + 2
        if place == 3:
            capture.release.reset_mock()
            raise KeyboardInterrupt
        return loaded.infer(*given)

    camera = Camera(0)
    summary = write_inference(loaded, interrupted, camera, camera, tmp_path, 0.1, {}, threads=2)
    capture.release.assert_called_once_with()
    assert summary["frames"] == 3
    assert {line["frame"] for line in associations(tmp_path)} == {0, 1, 2}


class Interrupted(FrameSource):
    """Two frames, then Ctrl-C."""

    def __init__(self, image: np.ndarray) -> None:
        self.image = image

    @property
    def name(self) -> str:
        return "interrupted"

    @property
    def frame_rate(self) -> float:
        return 30.0

    def __iter__(self) -> Iterator[Frame]:
        yield Frame(0, 0.0, self.image)
        yield Frame(1, 1 / 30, self.image)
        raise KeyboardInterrupt


@pytest.mark.parametrize("threads", [1, 3])
def test_ctrl_c_keeps_the_results_so_far(
    threads: int, skill: Path, demonstration_frames: tuple[np.ndarray, ...], tmp_path: Path
) -> None:
    loaded, source = Skill.load(skill), Interrupted(demonstration_frames[0])
    with pytest.raises(KeyboardInterrupt):
        write_inference(loaded, loaded.infer, source, source, tmp_path, 0.1, {}, threads)
    assert {line["frame"] for line in associations(tmp_path)} == {0, 1}
    assert json.loads((tmp_path / "metrics.json").read_text())["frames"] == 2
    # A second time, the results of the first are earlier ones, which stay.
    (tmp_path / "associations.jsonl").write_text("earlier")
    with pytest.raises(KeyboardInterrupt):
        write_inference(loaded, loaded.infer, source, source, tmp_path, 0.1, {}, threads)
    assert (tmp_path / "associations.jsonl").read_text() == "earlier"


def test_camera_that_changes_size_keeps_the_results_so_far(
    skill: Path, demonstration_frames: tuple[np.ndarray, ...], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    capture = Mock(spec=cv2.VideoCapture)
    capture.get.return_value = 30.0
    pictures = [*demonstration_frames[:3], demonstration_frames[3][:100]]
    capture.read.side_effect = [(True, frame[:, :, ::-1]) for frame in pictures]
    monkeypatch.setattr(cv2, "VideoCapture", lambda index: capture)
    loaded, camera = Skill.load(skill), Camera(0)
    with pytest.raises(InputError, match=r"^camera 0: frame 3 is 160x100 pixels; expected 160x120"):
        write_inference(loaded, loaded.infer, camera, camera, tmp_path, 0.1, {}, threads=1)
    assert {line["frame"] for line in associations(tmp_path)} == {0, 1, 2}
    assert json.loads((tmp_path / "metrics.json").read_text())["frames"] == 3
    assert len(decoded(tmp_path / "overlay.mp4")) == 3


def test_failure_in_the_middle_keeps_the_results_so_far(
    skill: Path, demonstration_folder: Path, tmp_path: Path
) -> None:
    loaded, source, used = Skill.load(skill), ImageFolder(demonstration_folder), count()

    def fails(*given: Any) -> InferenceResult:
        if next(used) == 2:
            raise RuntimeError("out of memory")
        return loaded.infer(*given)

    with pytest.raises(RuntimeError, match="out of memory"):
        write_inference(loaded, fails, source, source, tmp_path, 0.1, {}, threads=1)
    assert {line["frame"] for line in associations(tmp_path)} == {0, 1}
    assert json.loads((tmp_path / "metrics.json").read_text())["frames"] == 2
