import torch

from geoskill.geometry.control_errors import point_to_point
from geoskill.geometry.primitives import NodeType
from geoskill.kernels.kernel import automorphisms
from geoskill.kernels.p2p import PointToPoint


def test_p2p_instances_are_pairs_of_points() -> None:
    assert PointToPoint().instances({NodeType.POINT: 3, NodeType.LINE: 9}).tolist() == [[0, 0, 1], [1, 2, 2]]
    assert PointToPoint().instances({NodeType.POINT: 1}).shape == (2, 0)


def test_p2p_automorphisms() -> None:
    assert automorphisms(PointToPoint) == ((0, 1), (1, 0))


def test_p2p_control_error() -> None:
    torch.manual_seed(0)
    first, second = torch.rand(2, 20, 2)
    assert torch.equal(PointToPoint().control_error([first, second]), point_to_point(first, second))
    error = PointToPoint().control_error([torch.tensor([[5.0, 1.0]]), torch.tensor([[2.0, 8.0]])])
    assert error.tolist() == [[3.0, -7.0]]
