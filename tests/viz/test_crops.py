"""Tests of the pictures of a task definition."""

from pathlib import Path

import cv2
import numpy as np

from geoskill.geometry.primitives import NodeType
from geoskill.skill.association import Node
from geoskill.skill.crops import crop_around
from geoskill.viz.crops import draw_crop, write_picture
from geoskill.viz.drawing import TOP_COLOR

GREY = np.full((480, 640, 3), 128, np.uint8)


def red(picture: np.ndarray) -> np.ndarray:
    return np.argwhere((picture == TOP_COLOR).all(axis=2))[:, ::-1]


def test_ring_leaves_the_point_visible() -> None:
    node = Node(NodeType.POINT, (300.0, 200.0))
    crop = crop_around(GREY, node)
    picture = draw_crop(crop, node)
    assert picture.shape == (240, 240, 3)  # twice 120
    center = 2 * (np.array([300.0 - crop.left, 200.0 - crop.top]) + 0.5) - 0.5
    distance = np.linalg.norm(red(picture) - center, axis=1)
    assert 0.06 * 240 < distance.min() <= distance.max() < 0.1 * 240


def test_lines_run_on_both_sides_of_the_line() -> None:
    node = Node(NodeType.LINE, (100.0, 200.0, 300.0, 200.0))
    crop = crop_around(GREY, node)
    picture = draw_crop(crop, node)
    row = 200.0 - crop.top
    above, below = (red(picture)[:, 1] < row).sum(), (red(picture)[:, 1] > row).sum()
    assert above == below > 200
    assert (picture[round(row)] == 128).all()


def test_picture_is_written_as_it_is(tmp_path: Path) -> None:
    picture = np.random.default_rng(0).integers(0, 256, (9, 7, 3), np.uint8)
    write_picture(tmp_path / "crop.png", picture)
    np.testing.assert_array_equal(cv2.imread(str(tmp_path / "crop.png"))[:, :, ::-1], picture)
