"""Damage that a decoder makes up for is said, and refused where that is wanted."""

import re
import warnings
from pathlib import Path

import numpy as np
import pytest

from geoskill.errors import InputError
from geoskill.io.video import VideoFile
from tests.io.test_video import noise, write_video


def said(path: Path) -> tuple[int, list[str]]:
    """Return the number of frames, and the warnings of reading a video twice."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        video = VideoFile(path)
        counts = {sum(1 for _ in video) for _ in range(2)}
    assert len(counts) == 1
    return counts.pop(), [str(warning.message) for warning in caught]


@pytest.mark.parametrize("suffix", [".mp4", ".mov", ".avi", ".webm", ".mkv"])
def test_whole_video_is_read_in_silence_and_strictly(tmp_path: Path, suffix: str) -> None:
    path = write_video(tmp_path / f"video{suffix}", noise(20))
    assert said(path) == (20, [])
    assert sum(1 for _ in VideoFile(path, strict=True)) == 20


@pytest.mark.parametrize("suffix", [".webm", ".mkv"])
def test_end_that_is_cut_off_by_less_than_a_second(tmp_path: Path, suffix: str) -> None:
    path = write_video(tmp_path / f"video{suffix}", noise(40), codec="libvpx" if suffix == ".webm" else "mpeg4")
    content = path.read_bytes()
    path.write_bytes(content[: int(0.93 * len(content))])
    frames, messages = said(path)
    assert 30 < frames < 40
    assert len(messages) == 2
    assert messages[0].startswith(f"{path}: ")
    assert re.search(r" [1-9]\d? of (39|40) frames are missing", messages[0])
    assert messages[0].endswith("; it is taken as it is (strict_video=true refuses it)")
    for _ in range(2):  # the second reading reports the same as the first
        with pytest.raises(InputError, match=rf"^{path}: .*; expected a video without damage, or strict_video=false"):
            list(VideoFile(path, strict=True))


def overwritten(path: Path, share: float) -> Path:
    """Return a video with a part of its pictures, from its middle on, overwritten by noise."""
    data = bytearray(path.read_bytes())
    start, size = len(data) // 2, int(share * len(data))
    data[start : start + size] = np.random.default_rng(1).bytes(size)
    path.write_bytes(data)
    return path


def test_damaged_moment_is_said_and_refused_strictly(tmp_path: Path) -> None:
    path = overwritten(write_video(tmp_path / "bad.mp4", noise(40)), 0.02)
    frames, messages = said(path)
    assert 37 <= frames <= 40
    assert len(messages) == 2
    assert re.search(r" frame\(s\) are damaged,.* the first at frame (1[89]|2[0-3]): ", messages[0])
    with pytest.raises(InputError, match=rf"^{path}: frame (1[89]|2[0-3]): .*; expected a video without damage"):
        list(VideoFile(path, strict=True))


def test_longer_damage_breaks_a_video(tmp_path: Path) -> None:
    """Of the ten frames of a second, and a few more."""
    path = overwritten(write_video(tmp_path / "bad.mp4", noise(40)), 0.4)
    read = []
    with pytest.raises(
        InputError, match=r"bad\.mp4: the video breaks at frame \d+: (cannot be decoded|the frame is damaged)"
    ):
        read.extend(VideoFile(path))
    assert 15 < len(read) < 35


def test_unknown_coding_is_refused(tmp_path: Path) -> None:
    path = write_video(tmp_path / "video.avi", noise(5))
    path.write_bytes(path.read_bytes().replace(b"FMP4", b"XyZ9"))
    with pytest.raises(InputError, match=rf"^{path}: the video is coded in a way that is not known; expected one that"):
        VideoFile(path)
