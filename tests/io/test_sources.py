"""Opening a source by path or number, and reading it to its end."""

from pathlib import Path
from unittest.mock import Mock

import av
import cv2
import numpy as np
import pytest

from geoskill.errors import InputError
from geoskill.io.camera import Camera
from geoskill.io.sources import open_frames, read_all
from geoskill.io.video import ImageFolder, VideoFile


def folder_of(path: Path, count: int) -> Path:
    """Write uniform pictures whose gray level is their number."""
    path.mkdir()
    for number in range(count):
        assert cv2.imwrite(str(path / f"{number}.png"), np.full((4, 6, 3), number, np.uint8))
    return path


class TestOpenFrames:
    def test_folder_named_by_digits_is_not_a_camera(self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        folder_of(tmp_path / "7", 1)
        monkeypatch.chdir(tmp_path)
        source = open_frames("7", frame_rate=5.0)
        assert isinstance(source, ImageFolder)
        assert source.frame_rate == 5.0

    def test_video_file(self, tmp_path: Path) -> None:
        path = tmp_path / "demo.mp4"
        with av.open(str(path), "w") as container:
            stream = container.add_stream("mpeg4", rate=10)
            assert isinstance(stream, av.VideoStream)
            stream.height, stream.width = 48, 64
            container.mux(stream.encode(av.VideoFrame.from_ndarray(np.zeros((48, 64, 3), np.uint8), format="rgb24")))
            container.mux(stream.encode(None))
        source = open_frames(str(path))
        assert isinstance(source, VideoFile)
        assert source.frame_rate == 10.0

    @pytest.mark.parametrize("source", [3, "3"])
    def test_camera_named_by_number(self, source: str | int, monkeypatch: pytest.MonkeyPatch) -> None:
        opened = Mock(return_value=Mock(spec=cv2.VideoCapture, **{"get.return_value": 24.0}))
        monkeypatch.setattr(cv2, "VideoCapture", opened)
        camera = open_frames(source)
        assert isinstance(camera, Camera)
        assert (camera.name, camera.frame_rate) == ("camera 3", 24.0)
        assert open_frames(source, frame_rate=15.0).frame_rate == 15.0
        assert {call.args for call in opened.call_args_list} == {(3,)}

    @pytest.mark.parametrize("source", ["nowhere.mp4", "", "-1"])
    def test_missing_source_is_refused(self, source: str) -> None:
        with pytest.raises(InputError, match=rf"'{source}' does not exist; expected a video \(mp4.*camera's index"):
            open_frames(source)


class TestReadAll:
    def test_every_frame(self, tmp_path: Path) -> None:
        frames = read_all(ImageFolder(folder_of(tmp_path / "three", 3)), minimum=3)
        assert [int(frame.image[0, -1, 0]) for frame in frames] == [0, 1, 2]

    def test_too_few_names_the_source_and_both_numbers(self, tmp_path: Path) -> None:
        source = ImageFolder(folder_of(tmp_path / "one", 1))
        with pytest.raises(InputError, match=r"one: 1 frame\(s\); expected at least 2"):
            read_all(source)
