"""Tests of crops: where they are cut, and what is drawn in them."""

import numpy as np
import pytest

from geoskill.geometry.primitives import NodeType
from geoskill.skill.association import Node
from geoskill.skill.crops import crop_around

IMAGE = np.arange(120 * 160 * 3, dtype=np.uint32).reshape(120, 160, 3).astype(np.uint8)


@pytest.mark.parametrize(
    ("node", "left", "top", "side"),
    [
        (Node(NodeType.POINT, (80.0, 60.0)), 65, 45, 30),
        (Node(NodeType.POINT, (2.0, 119.0)), 0, 90, 30),
        (Node(NodeType.POINT, (159.0, -5.0)), 130, 0, 30),
        (Node(NodeType.LINE, (40.0, 60.0, 100.0, 60.0)), 28, 18, 84),
        (Node(NodeType.LINE, (0.0, 0.0, 159.0, 119.0)), 20, 0, 120),  # longer than the crop can be
    ],
)
def test_crop_is_full_of_picture(node: Node, left: int, top: int, side: int) -> None:
    crop = crop_around(IMAGE, node)
    assert (crop.left, crop.top) == (left, top)
    np.testing.assert_array_equal(crop.image, IMAGE[top : top + side, left : left + side])
    assert crop.image.base is None  # no frame is kept alive


def test_crop_of_a_tiny_picture() -> None:
    tiny = np.zeros((5, 9, 3), np.uint8)
    assert crop_around(tiny, Node(NodeType.POINT, (4.0, 2.0))).image.shape == (5, 5, 3)
