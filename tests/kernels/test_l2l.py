import torch

from geoskill.geometry.control_errors import line_to_line
from geoskill.geometry.primitives import NodeType
from geoskill.kernels.kernel import automorphisms
from geoskill.kernels.l2l import LineToLine


def test_l2l_instances_are_pairs_of_lines() -> None:
    assert LineToLine().instances({NodeType.POINT: 9, NodeType.LINE: 3}).tolist() == [[0, 0, 1], [1, 2, 2]]
    assert LineToLine().instances({NodeType.LINE: 0}).shape == (2, 0)


def test_l2l_automorphisms() -> None:
    assert automorphisms(LineToLine) == ((0, 1), (1, 0))


def test_l2l_control_error() -> None:
    torch.manual_seed(0)
    first, second = 100 * torch.rand(2, 20, 4)
    assert torch.equal(LineToLine().control_error([first, second]), line_to_line(first, second))
    # Parallel, 4 px apart, the second on the right of the first.
    error = LineToLine().control_error([torch.tensor([[0.0, 0, 10, 0]]), torch.tensor([[20.0, 4, 30, 4]])])
    assert error.tolist() == [[4.0, 4.0]]
