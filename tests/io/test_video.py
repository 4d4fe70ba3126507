"""Frames of small videos written here, and the messages for bad input."""

import struct
from collections.abc import Sequence
from fractions import Fraction
from pathlib import Path

import av
import cv2
import numpy as np
import pytest

from geoskill.errors import InputError
from geoskill.io.frames import Frame
from geoskill.io.video import VideoFile

HEIGHT, WIDTH = 48, 64


def plain(level: int, height: int = HEIGHT, width: int = WIDTH) -> np.ndarray:
    """Return a picture, red on the left and gray on the right: shows swapped channels, mirroring and frame order."""
    image = np.full((height, width, 3), level, np.uint8)
    image[:, : width // 2] = (200, 20, 20)
    return image


def write_video(
    path: Path,
    images: Sequence[np.ndarray],
    rate: int = 10,
    ticks: Sequence[int] | None = None,
    options: dict[str, str] | None = None,
    codec: str | None = None,
    container: str | None = None,
) -> Path:
    codec = codec or {".webm": "libvpx", ".avi": "mpeg4"}.get(path.suffix, "libx264")
    pixels = {"gif": "rgb8", "apng": "rgb24"}.get(codec, "yuv420p")
    with av.open(str(path), "w", format=container, options=options or {}) as output:
        stream = output.add_stream(codec, rate=rate)
        assert isinstance(stream, av.VideoStream)
        stream.height, stream.width = images[0].shape[:2]
        stream.pix_fmt = pixels
        stream.bit_rate = 2_000_000
        for position, image in enumerate(images):
            frame = av.VideoFrame.from_ndarray(image, format="rgb24").reformat(format=pixels)
            frame.pts = position if ticks is None else ticks[position]
            frame.time_base = Fraction(1, rate)
            output.mux(stream.encode(frame))
        output.mux(stream.encode(None))
    return path


def state_duration(path: Path, duration_ms: float) -> None:
    """Replace the duration of a Matroska file (RFC 9559, 5.1.2.10: element 4489, 8 bytes, a float of milliseconds)."""
    data = bytearray(path.read_bytes())
    start = data.index(b"\x44\x89\x88") + 3
    data[start : start + 8] = struct.pack(">d", duration_ms)
    path.write_bytes(data)


def noise(count: int) -> list[np.ndarray]:
    """Return frames that do not compress, so that each takes up a large share of the file."""
    random = np.random.default_rng(0)
    return [random.integers(0, 256, (HEIGHT, WIDTH, 3), dtype=np.uint8) for _ in range(count)]


class TestVideoFile:
    @pytest.mark.parametrize("suffix", [".mp4", ".mov", ".avi", ".webm", ".mkv"])
    def test_round_trip(self, tmp_path: Path, suffix: str) -> None:
        levels = list(range(20, 240, 20))
        path = write_video(tmp_path / f"demo{suffix}", [plain(level) for level in levels])
        source = VideoFile(path)
        assert source.frame_rate == 10.0
        assert source.name == str(path)
        for _ in range(2):
            frames = list(source)
            assert [frame.index for frame in frames] == list(range(11))
            np.testing.assert_allclose([frame.time_s for frame in frames], np.arange(11) / 10, atol=2e-3)
            for frame, level in zip(frames, levels, strict=True):
                assert frame.image.dtype == np.uint8
                inside = frame.image[:, [4, 60]].astype(int)
                np.testing.assert_allclose(inside, plain(level)[:, [4, 60]], atol=12)

    @pytest.mark.parametrize(
        ("name", "codec", "container"),
        [
            ("demo.m4v", "libx264", "mp4"),
            ("demo", "libx264", "mp4"),
            ("demo.txt", "libx264", "mp4"),
            ("12:30.mp4", "libx264", "mp4"),
            ("100%03d.mp4", "libx264", "mp4"),
            ("demo.3gp", "libx264", "3gp"),
            ("demo.ts", "libx264", "mpegts"),
            ("demo.mts", "libx264", "mpegts"),
            ("demo.mpg", "mpeg2video", "vob"),
            ("demo.wmv", "wmv2", "asf"),
            ("demo.gif", "gif", "gif"),
            ("demo.png", "apng", "apng"),
        ],
    )
    def test_content_decides_not_the_name(self, tmp_path: Path, name: str, codec: str, container: str) -> None:
        levels = [40, 80, 120, 160, 200]
        path = write_video(tmp_path / name, [plain(level) for level in levels], 25, codec=codec, container=container)
        frames = list(VideoFile(path))
        np.testing.assert_allclose([frame.time_s for frame in frames], np.arange(5) / 25, atol=2e-3)
        grays = [int(frame.image[24, 60, 1]) for frame in frames]
        np.testing.assert_allclose(grays, levels, atol=24)  # of the 256 colors of a GIF

    def test_times_are_those_in_the_file_relative_to_the_first_frame(self, tmp_path: Path) -> None:
        path = write_video(tmp_path / "demo.mkv", noise(3), ticks=[5, 6, 9])
        assert [frame.time_s for frame in VideoFile(path)] == pytest.approx([0.0, 0.1, 0.4])

    def test_rate_that_the_file_does_not_state_is_that_of_its_frames(self, tmp_path: Path) -> None:
        path = write_video(tmp_path / "held.webm", noise(8), 1000, ticks=[133 * position for position in range(8)])
        source = VideoFile(path)
        assert source.frame_rate == pytest.approx(1000 / 133)
        assert [frame.time_s for frame in source] == pytest.approx([0.133 * position for position in range(8)])

    def test_given_frame_rate_overrides_the_files_but_not_the_times(self, tmp_path: Path) -> None:
        source = VideoFile(write_video(tmp_path / "demo.mp4", noise(3)), frame_rate=25.0)
        assert source.frame_rate == 25.0
        assert [frame.time_s for frame in source] == pytest.approx([0.0, 0.1, 0.2])

    def test_frame_rate_of_zero_is_refused(self, tmp_path: Path) -> None:
        with pytest.raises(InputError, match=r"frame_rate is 0; expected frames per second from"):
            VideoFile(write_video(tmp_path / "demo.mp4", noise(3)), frame_rate=0.0)

    @pytest.mark.parametrize(
        ("matrix", "red_side"),
        [((0, 1, -1, 0), "top"), ((0, -1, 1, 0), "bottom"), ((-1, 0, 0, -1), "right")],
        ids=["clockwise", "counterclockwise", "upside down"],
    )
    def test_rotation_in_the_file_is_applied(
        self, tmp_path: Path, matrix: tuple[int, int, int, int], red_side: str
    ) -> None:
        path = write_video(tmp_path / "phone.mp4", [plain(230)] * 2)
        data = bytearray(path.read_bytes())
        # ISO 14496-12, 8.3.2: the track header's matrix (a b u c d v x y w, 16.16) starts 44 bytes after its name.
        start = data.index(b"tkhd") + 44
        identity = np.array([1, 0, 0, 0, 1, 0, 0, 0, 1 << 14], ">i4") << np.array([16, 16, 30, 16, 16, 30, 16, 16, 16])
        assert bytes(data[start : start + 36]) == identity.astype(">i4").tobytes()
        a, b, c, d = matrix
        turned = np.array([a << 16, b << 16, 0, c << 16, d << 16, 0, 0, 0, 1 << 30], ">i4")
        data[start : start + 36] = turned.tobytes()
        path.write_bytes(data)
        image = next(iter(VideoFile(path))).image
        # The left half is red in the coded frame; a clockwise turn brings it to the top.
        expected = {"top": np.rot90(plain(230), -1), "bottom": np.rot90(plain(230)), "right": plain(230)[:, ::-1]}
        assert image.shape == expected[red_side].shape
        assert np.median(np.abs(image.astype(int) - expected[red_side])) <= 12

    def test_missing_file(self, tmp_path: Path) -> None:
        with pytest.raises(InputError, match=r"absent\.mp4: no such file; expected a video \(mp4, mov, avi"):
            VideoFile(tmp_path / "absent.mp4")

    @pytest.mark.parametrize("name", ["notes.txt", "notes.mp4", "notes"])
    def test_text_is_no_video(self, tmp_path: Path, name: str) -> None:
        (tmp_path / name).write_text("no video\n" * 500)  # FFmpeg would draw the first one
        with pytest.raises(
            InputError, match=rf"{name}: .*; expected a .*video.* \(mp4, mov, avi, webm, mkv or whatever"
        ):
            VideoFile(tmp_path / name)

    def test_picture_is_no_video(self, tmp_path: Path) -> None:
        assert cv2.imwrite(str(tmp_path / "1.jpg"), plain(120))
        with pytest.raises(
            InputError, match=r"1\.jpg: a single picture; expected a video \(mp4.*or a folder of images"
        ):
            VideoFile(tmp_path / "1.jpg")

    def test_file_that_is_not_a_video(self, tmp_path: Path) -> None:
        (tmp_path / "fake.mp4").write_text("no video " * 500)
        with pytest.raises(InputError, match=r"fake\.mp4: not readable \(Invalid data.*\); expected a complete video"):
            VideoFile(tmp_path / "fake.mp4")

    def test_empty_file(self, tmp_path: Path) -> None:
        (tmp_path / "empty.mp4").write_bytes(b"")
        with pytest.raises(InputError, match=r"empty\.mp4: the file is empty"):
            VideoFile(tmp_path / "empty.mp4")

    def test_sound_without_pictures(self, tmp_path: Path) -> None:
        with av.open(str(tmp_path / "sound.mkv"), "w") as container:
            stream = container.add_stream("pcm_s16le", rate=8000)
            assert isinstance(stream, av.AudioStream)
            sound = av.AudioFrame.from_ndarray(np.zeros((1, 800), np.int16), format="s16", layout="mono")
            sound.sample_rate = 8000
            container.mux(stream.encode(sound))
            container.mux(stream.encode(None))
        with pytest.raises(InputError, match=r"sound\.mkv: the file has no video stream; expected a video"):
            VideoFile(tmp_path / "sound.mkv")

    def test_video_without_frames(self, tmp_path: Path) -> None:
        with av.open(str(tmp_path / "none.mkv"), "w") as container:
            stream = container.add_stream("libx264", rate=10)
            assert isinstance(stream, av.VideoStream)
            stream.height, stream.width, stream.pix_fmt = HEIGHT, WIDTH, "yuv420p"
            container.start_encoding()
        with pytest.raises(InputError, match=r"none\.mkv: .*expected"):
            list(VideoFile(tmp_path / "none.mkv"))

    def test_truncated_before_its_index_cannot_be_opened(self, tmp_path: Path) -> None:
        path = write_video(tmp_path / "cut.mp4", noise(20))
        path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
        with pytest.raises(InputError, match=r"cut\.mp4: not readable"):
            VideoFile(path)

    @pytest.mark.parametrize(("name", "options"), [("cut.mp4", {"movflags": "faststart"}), ("cut.avi", {})])
    def test_truncated_in_the_middle_names_the_frame(self, tmp_path: Path, name: str, options: dict[str, str]) -> None:
        path = write_video(tmp_path / name, noise(40), options=options)
        path.write_bytes(path.read_bytes()[: path.stat().st_size * 6 // 10])
        read: list[Frame] = []
        with pytest.raises(InputError, match=r"the video breaks at frame \d+: .*expected a complete video") as caught:
            read.extend(VideoFile(path))
        assert 10 < len(read) < 30
        assert f"{name}: the video breaks at frame {len(read)}: " in str(caught.value)

    @pytest.mark.parametrize("name", ["cut.mkv", "cut.webm"])
    def test_truncated_although_the_container_hides_it(self, tmp_path: Path, name: str) -> None:
        path = write_video(tmp_path / name, noise(40))
        path.write_bytes(path.read_bytes()[: path.stat().st_size * 6 // 10])
        with pytest.raises(InputError, match=rf"{name}: the video breaks at frame \d+: 1\.\d of 4\.0 s are missing"):
            list(VideoFile(path))

    @pytest.mark.parametrize("name", ["late.mkv", "late.webm"])
    @pytest.mark.parametrize("writer", ["from zero", "from the first time stamp"])
    def test_matroska_that_begins_late(self, tmp_path: Path, name: str, writer: str) -> None:
        """Its duration may or may not include the ten seconds before its first time stamp."""
        path = write_video(tmp_path / name, noise(40), ticks=range(100, 140))
        if writer == "from the first time stamp":
            state_duration(path, 4000.0)
        frames = list(VideoFile(path))
        assert [frame.time_s for frame in frames] == pytest.approx(np.arange(40) / 10, abs=2e-3)

    @pytest.mark.parametrize("duration_ms", [14000.0, 4000.0])
    def test_matroska_that_begins_late_and_is_truncated(self, tmp_path: Path, duration_ms: float) -> None:
        path = write_video(tmp_path / "cut.mkv", noise(40), ticks=range(100, 140))
        state_duration(path, duration_ms)
        path.write_bytes(path.read_bytes()[: path.stat().st_size * 6 // 10])
        with pytest.raises(InputError, match=r"cut\.mkv: the video breaks at frame \d+: 1\.\d of \d+\.0 s are missing"):
            list(VideoFile(path))


@pytest.mark.parametrize("suffix", [".mkv", ".mp4", ".avi"])
def test_metadata_need_not_be_utf8(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"video{suffix}"
    with av.open(str(path), "w") as container:
        container.metadata["title"] = "A-TITLE"
        stream = container.add_stream("mpeg4", rate=30)
        stream.width, stream.height, stream.pix_fmt = 64, 48, "yuv420p"
        for value in range(3):
            image = np.full((48, 64, 3), 80 * value, np.uint8)
            container.mux(stream.encode(av.VideoFrame.from_ndarray(image, format="rgb24")))
        container.mux(stream.encode(None))
    content = path.read_bytes()
    assert b"A-TITLE" in content
    path.write_bytes(content.replace(b"A-TITLE", b"\xff\xfe\xc3(\xff\xff\x80"))
    assert len(list(VideoFile(path))) == 3
