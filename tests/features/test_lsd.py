"""Segments on edges drawn at known positions, and the differences between versions of OpenCV."""

from types import SimpleNamespace

import cv2
import numpy as np
import pytest

from geoskill.errors import InputError
from geoskill.features.lsd import detect_segments


def bright_rectangle() -> np.ndarray:
    """Return a picture whose edges lie at x = 49.5 and 149.5, y = 59.5 and 139.5."""
    image = np.zeros((200, 200), np.uint8)
    image[60:140, 50:150] = 200
    return image


def test_detect_segments_finds_the_edges_of_a_rectangle() -> None:
    segments, _ = detect_segments(bright_rectangle(), min_length=10.0)
    assert segments.shape == (4, 4)
    assert segments.dtype == np.float32
    x, y = segments[:, 0::2], segments[:, 1::2]
    horizontal = np.ptp(y, axis=1) < 0.5
    assert horizontal.tolist() == [True, True, False, False]  # the 100 px edges before the 80 px ones
    np.testing.assert_allclose(np.sort(y[horizontal].mean(axis=1)), [59.5, 139.5], atol=0.05)
    np.testing.assert_allclose(np.sort(x[~horizontal].mean(axis=1)), [49.5, 149.5], atol=0.05)
    # The detector sees rounded corners in the outermost two pixels of an edge.
    np.testing.assert_allclose(np.sort(x[horizontal], axis=1), [[49.5, 149.5]] * 2, atol=2)
    np.testing.assert_allclose(np.sort(y[~horizontal], axis=1), [[59.5, 139.5]] * 2, atol=2)


def test_detect_segments_returns_decreasing_lengths() -> None:
    segments, lengths = detect_segments(bright_rectangle(), min_length=0.0)
    np.testing.assert_allclose(lengths, np.linalg.norm(segments[:, 2:] - segments[:, :2], axis=1), rtol=1e-6)
    assert np.all(np.diff(lengths) <= 0)
    assert lengths.dtype == np.float32


def test_detect_segments_leaves_out_short_ones() -> None:
    assert len(detect_segments(bright_rectangle(), min_length=90.0)[0]) == 2
    assert len(detect_segments(bright_rectangle(), min_length=101.0)[0]) == 0


@pytest.mark.parametrize("shape", [(50, 60), (1, 1), (0, 0), (0, 5)])
def test_detect_segments_in_a_picture_without_edges(shape: tuple[int, int]) -> None:
    segments, lengths = detect_segments(np.full(shape, 7, np.uint8), min_length=0.0)
    assert segments.shape == (0, 4)
    assert lengths.shape == (0,)


def test_detect_segments_in_a_view_with_strides() -> None:
    wide = np.repeat(bright_rectangle(), 2, axis=1)
    np.testing.assert_array_equal(detect_segments(wide[:, ::2], 0.0)[0], detect_segments(bright_rectangle(), 0.0)[0])


@pytest.mark.parametrize("image", [np.zeros((4, 4, 3), np.uint8), np.zeros((4, 4), np.float32)])
def test_detect_segments_refuses_other_types_of_pictures(image: np.ndarray) -> None:
    # A TypeError if shape annotations are checked at run time.
    with pytest.raises((ValueError, TypeError), match=r"(?i)uint8"):
        detect_segments(image, 0.0)


def test_detect_segments_accepts_the_shape_of_opencv_4(monkeypatch: pytest.MonkeyPatch) -> None:
    lines = np.array([[[1, 2, 4, 6]], [[0, 0, 10, 0]], [[3, 3, 3.2, 3]]], np.float32)
    fake = SimpleNamespace(detect=lambda image: (lines, None, None, None))
    monkeypatch.setattr(cv2, "createLineSegmentDetector", lambda *_: fake)
    segments, lengths = detect_segments(np.zeros((9, 9), np.uint8), min_length=0.0)
    np.testing.assert_allclose(lengths, [10, 5])
    np.testing.assert_allclose(segments, np.array([[0, 0, 10, 0], [1, 2, 4, 6]]) + 0.125)


def test_detect_segments_names_an_opencv_without_the_detector(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delattr(cv2, "createLineSegmentDetector")
    with pytest.raises(InputError, match=rf"OpenCV {cv2.__version__} has no Line Segment Detector"):
        detect_segments(bright_rectangle(), 0.0)
