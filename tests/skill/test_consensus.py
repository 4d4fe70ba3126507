"""What several associations say together, against errors of a known translation."""

import numpy as np
import pytest

from geoskill.geometry.primitives import NodeType
from geoskill.kernels.kernel import Kernel
from geoskill.kernels.p2l import PointToLine
from geoskill.kernels.p2p import PointToPoint
from geoskill.skill.association import Association, Goal, Node
from geoskill.skill.consensus import consensus

POINT, LINE = NodeType.POINT, NodeType.LINE


def of_points(error: tuple[float, float]) -> Association:
    nodes = (Node(POINT, (error[0] + 30.0, error[1] + 40.0)), Node(POINT, (25.0, 45.0)))
    goal = Goal(((30.0, 40.0), None), error, (0.7, 0.7))
    return Association("m", "p2p", "sift", 1, 0.9, 0.1, nodes, error, goal=goal)


def of_line(angle: float, offset: tuple[float, float], noise: float = 0.0) -> Association:
    """Return a point that has to come to (30, 40), and a line through (25, 45) of this direction, in radians."""
    along = np.array([np.cos(angle), np.sin(angle)])
    ends = (*(np.array([25.0, 45.0]) - 20 * along).tolist(), *(np.array([25.0, 45.0]) + 20 * along).tolist())
    error = (float(along[0] * offset[1] - along[1] * offset[0]) + noise,)
    nodes = (Node(POINT, (30.0 + offset[0], 40.0 + offset[1])), Node(LINE, ends))
    return Association("m", "p2l", "x", 1, 0.9, 0.1, nodes, error, goal=Goal(((30.0, 40.0), None), error, (0.7,)))


def agreed(kernel: Kernel, *listed: Association) -> tuple[float, tuple[float, float]]:
    found = consensus(kernel, listed)
    assert found is not None
    return found.share, found.offset_px


def test_wrong_pairs_do_not_move_the_consensus() -> None:
    right = [of_points((20.0 + 0.3 * number, -7.0)) for number in range(5)]
    wrong = [of_points((-130.0, 4.0)), of_points((-128.0, 2.0)), of_points((90.0, 90.0))]
    share, offset = agreed(PointToPoint(), *wrong, *right)
    assert share == 5 / 8
    assert offset == pytest.approx((20.6, -7.0), abs=0.1)


def test_pairs_without_goal_error_do_not_agree() -> None:
    without = Association(
        "m", "p2p", "sift", 1, 0.9, 0.1, (Node(POINT, (0.0, 0.0)), Node(POINT, (1.0, 1.0))), (1.0, 1.0)
    )
    share, offset = agreed(PointToPoint(), without, of_points((3.0, 4.0)), of_points((3.0, 4.0)))
    assert share == 2 / 3
    assert offset == pytest.approx((3.0, 4.0))
    assert consensus(PointToPoint(), [without, of_points((3.0, 4.0))]) is None
    assert consensus(PointToPoint(), []) is None


def test_distances_to_lines_of_several_directions_give_the_whole_offset() -> None:
    lines = [of_line(angle, (8.0, -3.0)) for angle in (0.1, 0.9, 1.7, 2.6)]
    share, offset = agreed(PointToLine(), of_line(0.4, (8.0, -3.0), noise=60.0), *lines)
    assert share == 4 / 5
    assert offset == pytest.approx((8.0, -3.0), abs=1e-4)


def test_distances_to_parallel_lines_give_the_part_across_them() -> None:
    share, offset = agreed(PointToLine(), *(of_line(0.0, (8.0, -3.0)) for _ in range(3)))
    assert share == 1.0
    assert offset == pytest.approx((0.0, -3.0), abs=1e-4)
