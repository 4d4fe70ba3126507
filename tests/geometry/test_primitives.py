"""Node types and centers."""

import numpy as np
import pytest

from geoskill.geometry.primitives import NodeType, centers


def test_centers_are_points_and_midpoints() -> None:
    assert centers(np.array([[3.0, 4.0]])).tolist() == [[3.0, 4.0]]
    assert centers(np.array([[1.0, 1.0, 4.0, 5.0], [0.0, 0.0, 2.0, 0.0]])).tolist() == [[2.5, 3.0], [1.0, 0.0]]


@pytest.mark.parametrize("node_type", list(NodeType))
def test_centers_of_nothing(node_type: NodeType) -> None:
    assert centers(np.zeros((0, node_type.geometry_dim), np.float32)).shape == (0, 2)
