"""The motion of a camera that trembles, turns or rests, with somebody in front of it."""

import cv2
import numpy as np
import pytest

from geoskill.tracking.camera_motion import (
    IDENTITY,
    CameraMotion,
    camera_transforms,
    resized_transform,
    transformed,
)
from tests.carrying import HEIGHT, WIDTH, Carrying, draw

CORNERS = np.array([[0, 0], [WIDTH, 0], [0, HEIGHT], [WIDTH, HEIGHT]], np.float32)


def gray(pictures: list[np.ndarray]) -> list[np.ndarray]:
    return [cv2.cvtColor(picture, cv2.COLOR_RGB2GRAY) for picture in pictures]


def similarity(x: float, y: float, size: float = 1.0, degrees: float = 0.0) -> np.ndarray:
    """Return a shift after a turn and a change of size about the middle of the picture."""
    matrix = cv2.getRotationMatrix2D((WIDTH / 2, HEIGHT / 2), degrees, size)
    matrix[:, 2] += x, y
    return matrix


def shaken(pictures: list[np.ndarray], transforms: list[np.ndarray]) -> list[np.ndarray]:
    size = (WIDTH, HEIGHT)
    return [
        cv2.warpAffine(picture, transform, size, borderMode=cv2.BORDER_REPLICATE)
        for picture, transform in zip(pictures, transforms, strict=True)
    ]


def test_a_camera_at_rest_did_not_move_at_all() -> None:
    assert (camera_transforms(gray(draw(Carrying()))) == IDENTITY).all()


@pytest.mark.parametrize("kind", ["tremble", "drift", "turn", "brighter"])
def test_the_motion_is_found_behind_a_hand(kind: str) -> None:
    pictures = draw(Carrying(person=False, gain=1.2 if kind == "brighter" else 1.0))[::4]
    random = np.random.default_rng(0)
    count = len(pictures)
    transforms = {
        "tremble": [similarity(*random.normal(0, 3, 2)) for _ in range(count)],
        "drift": [similarity(12 * t / count, -6 * t / count) for t in range(count)],
        "turn": [similarity(0, 0, 1 + 0.04 * t / count, 4 * t / count) for t in range(count)],
        "brighter": [similarity(3, 2)] * count,
    }[kind]
    transforms[0] = IDENTITY
    found = camera_transforms(gray(shaken(pictures, transforms)))
    errors = [
        np.abs(transformed(own, CORNERS) - transformed(true, CORNERS)).max()
        for own, true in zip(found, transforms, strict=True)
    ]
    assert np.percentile(errors, 60) < 0.5, "half a pixel, at a corner of the picture"
    assert max(errors) < 4.0, "the printed thing has as many edges as the table, in some pictures"


def test_a_picture_without_edges_says_nothing() -> None:
    plain = [np.full((60, 80), value, np.uint8) for value in (90, 120)]
    assert (camera_transforms(plain) == IDENTITY).all()


def test_a_picture_that_shows_something_else_keeps_the_last_motion() -> None:
    first = gray(draw(Carrying()))[0]
    moved = cv2.warpAffine(first, similarity(4, 0), (WIDTH, HEIGHT), borderMode=cv2.BORDER_REPLICATE)
    other = np.random.default_rng(1).integers(0, 255, first.shape).astype(np.uint8)
    found = camera_transforms([first, moved, other])
    np.testing.assert_allclose(found[1][:, 2], (4, 0), atol=0.3)
    np.testing.assert_array_equal(found[2], found[1])


def test_resized_transform_acts_as_the_transform_between_resizes() -> None:
    transform, factor = similarity(5, -3, 1.1, 20), 2.5
    points = np.random.default_rng(0).uniform(0, 100, (6, 2)).astype(np.float32)
    small = (points + 0.5) / factor - 0.5
    expected = (transformed(transform, small) + 0.5) * factor - 0.5
    np.testing.assert_allclose(transformed(resized_transform(transform, factor), points), expected, rtol=1e-4)


def test_camera_motion_between_compared_frames() -> None:
    camera = CameraMotion(np.array([0, 10]), np.stack([IDENTITY, similarity(4, 2)]))
    segment = np.array([[10, 20, 30, 40]], np.float32)
    np.testing.assert_allclose(camera.from_first(5, segment), segment + np.array([2, 1, 2, 1]))
    np.testing.assert_allclose(camera.to_first(10, camera.from_first(10, segment)), segment, atol=1e-5)
    assert not camera.at_rest
    at_rest = CameraMotion(np.array([0]), IDENTITY[None])
    assert at_rest.at_rest
    assert at_rest.to_first(0, segment) is segment
