import torch

from geoskill.geometry.control_errors import point_to_line
from geoskill.geometry.primitives import NodeType
from geoskill.kernels.kernel import automorphisms
from geoskill.kernels.p2l import PointToLine


def test_p2l_instances_are_points_with_lines() -> None:
    index = PointToLine().instances({NodeType.POINT: 2, NodeType.LINE: 3})
    assert index.tolist() == [[0, 0, 0, 1, 1, 1], [0, 1, 2, 0, 1, 2]]
    assert PointToLine().instances({NodeType.POINT: 4, NodeType.LINE: 0}).shape == (2, 0)


def test_p2l_automorphisms() -> None:
    assert automorphisms(PointToLine) == ((0, 1),)


def test_p2l_control_error() -> None:
    torch.manual_seed(0)
    point, line = 100 * torch.rand(20, 2), 100 * torch.rand(20, 4)
    assert torch.equal(PointToLine().control_error([point, line]), point_to_line(point, line))
    # 4 px below a line that is walked to the right: on its right hand, so positive.
    error = PointToLine().control_error([torch.tensor([[9.0, 7.0]]), torch.tensor([[0.0, 3.0, 5.0, 3.0]])])
    assert error.tolist() == [[4.0]]
