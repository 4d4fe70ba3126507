"""Videos written, read back, and what is left behind when writing fails."""

from pathlib import Path

import av
import numpy as np
import pytest

from geoskill.errors import InputError
from geoskill.io.video import VideoFile
from geoskill.viz import video_writer
from geoskill.viz.video_writer import VideoWriter


def pictures(count: int, height: int = 48, width: int = 64) -> list[np.ndarray]:
    """Plain frames, each of another color; the channels differ, so a swap shows."""
    return [np.full((height, width, 3), (20 + 20 * i, 100, 220 - 20 * i), np.uint8) for i in range(count)]


def write(path: Path, images: list[np.ndarray], frame_rate: float = 12.5) -> None:
    with VideoWriter(path, frame_rate) as writer:
        for image in images:
            writer.write(image)


@pytest.mark.parametrize("suffix", [".mp4", ".mov", ".mkv"])
def test_round_trip(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"overlay{suffix}"
    write(path, pictures(8))
    source = VideoFile(path)
    assert source.frame_rate == 12.5
    frames = list(source)
    assert [frame.time_s for frame in frames] == pytest.approx([i / 12.5 for i in range(8)], abs=2e-3)
    for frame, image in zip(frames, pictures(8), strict=True):
        np.testing.assert_allclose(frame.image.astype(int), image, atol=6)
    assert [file.name for file in tmp_path.iterdir()] == [path.name]


def test_it_is_h264_with_chroma_that_players_know(tmp_path: Path) -> None:
    write(tmp_path / "overlay.mp4", pictures(3))
    with av.open(str(tmp_path / "overlay.mp4")) as container:
        context = container.streams.video[0].codec_context
        assert (context.name, context.pix_fmt) == ("h264", "yuv420p")


def test_odd_sizes_are_padded_and_coordinates_stay(tmp_path: Path) -> None:
    image = np.full((47, 63, 3), 60, np.uint8)
    image[8:16, 16:32] = 240
    write(tmp_path / "overlay.mp4", [image] * 3)
    frame = next(iter(VideoFile(tmp_path / "overlay.mp4"))).image
    assert frame.shape == (48, 64, 3)
    expected = np.pad(image, ((0, 1), (0, 1), (0, 0)), mode="edge")
    assert np.abs(frame.astype(int) - expected).mean() < 3
    np.testing.assert_allclose(frame[-1].astype(int), 60, atol=15)
    np.testing.assert_allclose(frame[:, -1].astype(int), 60, atol=15)


def test_fractional_rate_of_television(tmp_path: Path) -> None:
    write(tmp_path / "overlay.mp4", pictures(3), frame_rate=30000 / 1001)
    with av.open(str(tmp_path / "overlay.mp4")) as container:
        rate = container.streams.video[0].average_rate
        assert rate is not None
        assert (rate.numerator, rate.denominator) == (30000, 1001)


@pytest.mark.parametrize("suffix", [".mp4", ".mov", ".mkv"])
@pytest.mark.parametrize(
    ("times", "frame_rate"),
    [
        ([0.0, 0.033, 0.067, 0.5, 0.6, 1.5, 1.533], 30.0),  # a phone in the dark
        ([0.0, 2.0, 4.0, 6.0], 0.5),  # a time lapse
        ([0.133 * number for number in range(8)], 1 / 0.133),
    ],
    ids=["variable", "slow", "held"],
)
def test_frames_keep_their_times(tmp_path: Path, suffix: str, times: list[float], frame_rate: float) -> None:
    path = tmp_path / f"overlay{suffix}"
    with VideoWriter(path, frame_rate) as writer:
        for image, time_s in zip(pictures(len(times)), times, strict=True):
            writer.write(image, time_s)
    assert [frame.time_s for frame in VideoFile(path)] == pytest.approx(times, abs=1e-3)
    with av.open(str(path)) as container:
        assert container.duration is not None
        assert container.duration / av.time_base == pytest.approx(times[-1] + min(1 / frame_rate, 0.1), abs=2e-3)


def test_frames_at_one_time_follow_each_other(tmp_path: Path) -> None:
    path = tmp_path / "overlay.mp4"
    with VideoWriter(path, 30.0) as writer:
        for image, time_s in zip(pictures(4), [0.0, 0.5, 0.5, 0.4], strict=True):
            writer.write(image, time_s)
    assert [frame.time_s for frame in VideoFile(path)] == pytest.approx([0.0, 0.5, 0.5, 0.5], abs=1e-3)


@pytest.mark.parametrize("kind", [RuntimeError, KeyboardInterrupt])
def test_failure_leaves_the_earlier_file_and_nothing_else(tmp_path: Path, kind: type[BaseException]) -> None:
    path = tmp_path / "overlay.mp4"
    path.write_bytes(b"of an earlier run")
    with pytest.raises(kind), VideoWriter(path, 10.0) as writer:
        writer.write(pictures(1)[0])
        assert len(list(tmp_path.iterdir())) == 2
        raise kind
    assert [file.name for file in tmp_path.iterdir()] == ["overlay.mp4"]
    assert path.read_bytes() == b"of an earlier run"


def test_earlier_file_is_replaced_only_at_the_end(tmp_path: Path) -> None:
    path = tmp_path / "overlay.mp4"
    path.write_bytes(b"of an earlier run")
    with VideoWriter(path, 10.0) as writer:
        for image in pictures(3):
            writer.write(image)
        assert path.read_bytes() == b"of an earlier run"
    assert len(list(VideoFile(path))) == 3


def test_no_frame_writes_nothing(tmp_path: Path) -> None:
    with VideoWriter(tmp_path / "overlay.mp4", 10.0):
        pass
    assert list(tmp_path.iterdir()) == []


def test_other_size_is_refused(tmp_path: Path) -> None:
    with (
        pytest.raises(ValueError, match=r"frame 1 has shape \(24, 32, 3\); expected \(48, 64, 3\)"),
        VideoWriter(tmp_path / "overlay.mp4", 10.0) as writer,
    ):
        writer.write(pictures(1)[0])
        writer.write(pictures(1, height=24, width=32)[0])
    assert list(tmp_path.iterdir()) == []


def test_bad_names_and_rates(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"overlay\.txt: cannot write this type of file; expected \.mp4, \.mov, \.mkv"):
        VideoWriter(tmp_path / "overlay.txt", 10.0)
    with pytest.raises(InputError, match=r"overlay\.mp4: its folder does not exist"):
        VideoWriter(tmp_path / "absent" / "overlay.mp4", 10.0)
    with pytest.raises(InputError, match=r"frame_rate is 0; expected frames per second from 0\.01 to 10000"):
        VideoWriter(tmp_path / "overlay.mp4", 0.0)


def test_without_an_encoder_the_message_says_what_to_do(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(video_writer, "H264_ENCODERS", ("no_such_encoder",))
    with pytest.raises(RuntimeError, match=r"no H\.264 encoder \(no_such_encoder\); install av"):
        VideoWriter(tmp_path / "overlay.mp4", 10.0)


def test_next_encoder_is_taken_where_the_first_is_missing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(video_writer, "H264_ENCODERS", ("no_such_encoder", "libx264"))
    write(tmp_path / "overlay.mp4", pictures(3))
    assert len(list(VideoFile(tmp_path / "overlay.mp4"))) == 3


def test_encoder_that_cannot_start_leaves_nothing(tmp_path: Path) -> None:
    # H.264 has no picture of this size: the encoder refuses it when the first frame opens it.
    with pytest.raises((av.error.FFmpegError, ValueError)), VideoWriter(tmp_path / "overlay.mp4", 10.0) as writer:
        writer.write(np.zeros((2, 40000, 3), np.uint8))
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("rate", [0.01, 0.5, 29.97, 10_000.0])
def test_extreme_frame_rates(tmp_path: Path, rate: float) -> None:
    path = tmp_path / "video.mp4"
    with VideoWriter(path, rate) as writer:
        for value in (0, 255):
            writer.write(np.full((48, 64, 3), value, np.uint8))
    assert [frame.time_s for frame in VideoFile(path)] == pytest.approx([0.0, 1 / rate], rel=1e-3, abs=2e-5)
