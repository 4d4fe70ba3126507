"""Opening a source by path or number, and reading it to its end."""

from collections.abc import Iterator
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from threading import Thread
from unittest.mock import Mock

import av
import cv2
import numpy as np
import pytest

from geoskill.errors import InputError
from geoskill.io.camera import Camera
from geoskill.io.frames import Frame
from geoskill.io.image_folder import ImageFolder
from geoskill.io.sources import is_live, open_frames, read_all
from geoskill.io.video import VideoFile, VideoStream
from tests.io.test_video import write_video


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

    @pytest.mark.parametrize("name", ["2024_01_05", "1e5", "007", "5"])
    def test_folder_whose_name_is_a_number(self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str) -> None:
        folder_of(tmp_path / name, 2)
        monkeypatch.chdir(tmp_path)
        assert [frame.index for frame in open_frames(name)] == [0, 1]

    def test_device_file_is_a_camera(self, monkeypatch: pytest.MonkeyPatch) -> None:
        opened = Mock(return_value=Mock(spec=cv2.VideoCapture, **{"get.return_value": 24.0}))
        monkeypatch.setattr(cv2, "VideoCapture", opened)
        camera = open_frames("/dev/null")  # a character device, as /dev/video0 is
        assert isinstance(camera, Camera)
        assert is_live(camera)
        assert camera.name == "/dev/null"
        opened.assert_called_once_with("/dev/null")

    @pytest.mark.parametrize("source", ["nowhere.mp4", "", "-1", "20240105", "007", "100", "1e5", "\0", "x" * 5000])
    def test_missing_source_is_refused(self, source: str) -> None:
        with pytest.raises(InputError, match=r"' does not exist; expected a video \(mp4.*a camera's index or a URL"):
            open_frames(source)


class Handler(SimpleHTTPRequestHandler):
    """Serves files; those of /live/ as a camera does, without saying how long they are."""

    def do_GET(self) -> None:
        if not self.path.startswith("/live/"):
            return super().do_GET()
        self.send_response(200)
        self.end_headers()
        self.wfile.write(Path(self.directory, self.path.removeprefix("/live/")).read_bytes())

    def log_message(self, *_: object) -> None:
        pass


@pytest.fixture
def served(tmp_path: Path) -> Iterator[str]:
    """The address of a server on this machine that serves the temporary folder."""
    with ThreadingHTTPServer(("127.0.0.1", 0), partial(Handler, directory=str(tmp_path))) as server:
        thread = Thread(target=server.serve_forever, args=(0.01,))
        thread.start()
        yield f"http://127.0.0.1:{server.server_port}"
        server.shutdown()
        thread.join()


class TestVideoStream:
    def test_recording_on_a_server(self, tmp_path: Path, served: str) -> None:
        write_video(tmp_path / "demo.mp4", [np.full((48, 64, 3), level, np.uint8) for level in (40, 80, 120)])
        source = open_frames(f"{served}/demo.mp4")
        assert isinstance(source, VideoStream)
        assert not is_live(source)
        assert source.frame_rate == 10.0
        assert [frame.time_s for frame in source] == pytest.approx([0.0, 0.1, 0.2])

    def test_stream_that_states_no_duration_is_live(self, tmp_path: Path, served: str) -> None:
        write_video(tmp_path / "camera.ts", [np.zeros((48, 64, 3), np.uint8)] * 3, container="mpegts")
        source = open_frames(f"{served}/live/camera.ts")
        assert is_live(source)
        read: list[Frame] = []
        with pytest.raises(InputError, match=r"camera\.ts: ends at frame \d \(.*\); expected it to go on"):
            read.extend(source)
        assert read[0].image.shape == (48, 64, 3)

    @pytest.mark.parametrize("name", ["absent.mp4", "notes.txt"])
    def test_what_cannot_be_opened(self, tmp_path: Path, served: str, name: str) -> None:
        (tmp_path / "notes.txt").write_text("no video")
        with pytest.raises(InputError, match=rf"^{served}/{name}: .*; expected .*a video"):
            open_frames(f"{served}/{name}")

    def test_unknown_protocol_and_hidden_password(self) -> None:
        with pytest.raises(InputError, match=r"^gopherx://camera/1: cannot be opened \(.*\); expected the address"):
            open_frames("gopherx://user:secret@camera/1")


class TestReadAll:
    def test_every_frame(self, tmp_path: Path) -> None:
        frames = read_all(ImageFolder(folder_of(tmp_path / "three", 3)), minimum=3)
        assert [int(frame.image[0, -1, 0]) for frame in frames] == [0, 1, 2]

    def test_too_few_names_the_source_and_both_numbers(self, tmp_path: Path) -> None:
        source = ImageFolder(folder_of(tmp_path / "one", 1))
        with pytest.raises(InputError, match=r"one: 1 frame\(s\); expected at least 2"):
            read_all(source)
