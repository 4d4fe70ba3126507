"""Planes are drawn as outlines and conics as ellipses, as features and as nodes."""

import numpy as np
import pytest

from geoskill.geometry.ellipses import ellipse_of_axes
from geoskill.geometry.primitives import NodeType
from geoskill.skill.association import Node
from geoskill.viz.drawing import Scale
from geoskill.viz.marks import draw_feature, draw_node

GRAY = 77
PLANE = np.array([[100.0, 60.0], [300.0, 60.0], [300.0, 200.0], [100.0, 200.0]])
CONIC = ellipse_of_axes((400.0, 300.0), (120.0, 60.0), 0.4).reshape(4, 2)


def on_outline(node_type: NodeType) -> np.ndarray:
    """Places on the outline, between the points that it is given by."""
    if node_type is NodeType.PLANE:
        return (PLANE + np.roll(PLANE, 1, axis=0)) / 2
    center, arms = CONIC.mean(axis=0), [(CONIC[0] - CONIC[1]) / 2, (CONIC[2] - CONIC[3]) / 2]
    return np.array(
        [center + (arms[0] * first + arms[1] * second) * 0.5**0.5 for first in (-1, 1) for second in (-1, 1)]
    )


@pytest.mark.parametrize(("node_type", "xy"), [(NodeType.PLANE, PLANE), (NodeType.CONIC, CONIC)])
@pytest.mark.parametrize("as_node", [False, True])
def test_outline_is_drawn_all_the_way_round(node_type: NodeType, xy: np.ndarray, as_node: bool) -> None:
    canvas = np.full((480, 640, 3), GRAY, np.uint8)
    scale = Scale.of(canvas)
    if as_node:
        draw_node(canvas, scale, Node(node_type, tuple(xy.ravel().tolist())), (230, 20, 30), 3)
    else:
        draw_feature(canvas, scale, node_type, xy)
    for x, y in on_outline(node_type).round().astype(int):
        assert (canvas[y - 2 : y + 3, x - 2 : x + 3] != GRAY).any()
    x, y = xy.mean(axis=0).round().astype(int)
    assert (canvas[y - 2 : y + 3, x - 2 : x + 3] == GRAY).all()
