"""Frames with depth."""

import numpy as np
import pytest

from geoskill.geometry.depth_camera import DepthCamera
from geoskill.io.arrays import ArrayFrames
from geoskill.io.frames import Frame, FrameSource
from geoskill.io.kept_frames import KeptFrames
from geoskill.io.segment import Position, Segment

CAMERA = DepthCamera(10.0, 10.0, 1.5, 1.0)
PICTURE = np.zeros((3, 4, 3), np.uint8)


def depth(value: float) -> np.ndarray:
    rows = np.full((3, 4), 0.5, np.float32)
    rows[1, 2] = value
    return rows


@pytest.mark.parametrize("depth_m", [depth(0.7), depth(np.nan), np.full((3, 4), np.nan, np.float32)])
def test_frame_takes_meters_and_nan(depth_m: np.ndarray) -> None:
    assert Frame(0, 0.0, PICTURE, depth_m, CAMERA).nbytes == 3 * 4 * (3 + 4)


@pytest.mark.parametrize(
    ("depth_m", "camera", "expected"),
    [
        (depth(0.0), CAMERA, "is 0 somewhere"),
        (depth(-0.1), CAMERA, "is -0.1 somewhere"),
        (depth(np.inf), CAMERA, "is inf somewhere"),
        (depth(1.0)[:2], CAMERA, r"float32 \[2, 4\]; expected meters \[3, 4\]"),
        (depth(1.0), None, "no depth_camera"),
    ],
)
def test_frame_names_what_is_no_depth(depth_m: np.ndarray, camera: DepthCamera | None, expected: str) -> None:
    with pytest.raises(ValueError, match=expected):
        Frame(7, 0.0, PICTURE, depth_m, camera)


class Deep(FrameSource):
    """Six frames, each as deep in meters as its number plus one."""

    name = "deep"
    frame_rate = 10.0

    def __iter__(self):
        for frame in ArrayFrames([PICTURE] * 6, self.frame_rate):
            yield Frame(frame.index, frame.time_s, PICTURE, np.full((3, 4), 1.0 + frame.index, np.float32), CAMERA)


def test_segment_keeps_depth_and_its_camera() -> None:
    part = list(Segment(Deep(), Position(2, in_frames=True), stride=2))
    assert [(frame.index, frame.time_s, float(frame.depth_m.max())) for frame in part] == [
        (0, 0.0, 3.0),
        (1, pytest.approx(0.2), 5.0),
    ]
    assert part[0].depth_camera == CAMERA


def test_kept_frames_count_the_memory_of_depth() -> None:
    own, picture = 6 * 12 * 7 / 1e6, 6 * 12 * 3 / 1e6
    assert len(KeptFrames(Deep(), memory_mb=own)._kept) == 6
    assert len(KeptFrames(Deep(), memory_mb=picture)._kept) == 2
