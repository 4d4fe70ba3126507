"""A fake camera: number 3 exists, does not report its rate, delivers four pictures and is then unplugged."""

import time
from unittest.mock import Mock

import cv2
import numpy as np
import pytest

from geoskill.errors import InputError
from geoskill.io.camera import Camera

PICTURE = np.full((4, 6, 3), (200, 20, 9), np.uint8)


@pytest.fixture(autouse=True)
def captures(monkeypatch: pytest.MonkeyPatch) -> list[Mock]:
    """Return the captures that were opened; each reading of the clock is half a second after the last."""
    opened: list[Mock] = []
    real = cv2.VideoCapture

    def capture_of(index: int) -> Mock:
        capture = Mock(spec=real)
        capture.isOpened.return_value = index == 3
        capture.get.return_value = 0.0
        capture.read.side_effect = [(True, PICTURE[:, :, ::-1])] * 4 + [(False, None)]
        opened.append(capture)
        return capture

    monkeypatch.setattr(cv2, "VideoCapture", capture_of)
    times = iter(np.arange(100.0, 200.0, 0.5))
    monkeypatch.setattr(time, "monotonic", lambda: float(next(times)))
    return opened


def all_released(captures: list[Mock]) -> bool:
    return all(capture.release.called for capture in captures)


def test_camera_stops_at_max_frames_and_is_released(captures: list[Mock]) -> None:
    camera = Camera(3, max_frames=2)
    assert all_released(captures)
    frames = list(camera)
    assert [(frame.index, frame.time_s) for frame in frames] == [(0, 0.0), (1, 0.5)]
    np.testing.assert_array_equal(frames[0].image, PICTURE)
    assert all_released(captures)
    assert camera.frame_rate == 30.0
    assert camera.name == "camera 3"


def test_camera_is_released_when_the_loop_is_left(captures: list[Mock]) -> None:
    frames = iter(Camera(3))
    next(frames)
    assert not all_released(captures)
    frames.close()  # type: ignore[attr-defined]
    assert all_released(captures)


def test_camera_raises_when_unplugged(captures: list[Mock]) -> None:
    with pytest.raises(InputError, match="camera 3: no picture after 4 frames"):
        list(Camera(3))
    assert all_released(captures)


def test_camera_raises_when_it_cannot_be_opened(captures: list[Mock]) -> None:
    with pytest.raises(InputError, match=r"camera 5: cannot be opened; expected the index of a connected camera"):
        Camera(5)
    assert all_released(captures)


def test_camera_raises_when_its_pictures_change_size(captures: list[Mock]) -> None:
    camera = Camera(3)
    message = r"^camera 3: frame 2 is 8x4 pixels; expected 6x4, as before \(another program may have set the camera\)$"
    frames = iter(camera)
    first = next(frames)
    captures[-1].read.side_effect = [(True, PICTURE), (True, np.zeros((4, 8, 3), np.uint8))]
    assert next(frames).image.shape == first.image.shape
    with pytest.raises(InputError, match=message):
        next(frames)
    assert all_released(captures)
