import pytest
import torch

from geoskill.geometry.control_errors import parallel
from geoskill.geometry.primitives import NodeType
from geoskill.kernels.kernel import automorphisms
from geoskill.kernels.par import Parallel


def test_par_instances_are_pairs_of_lines() -> None:
    assert Parallel().instances({NodeType.POINT: 9, NodeType.LINE: 3}).tolist() == [[0, 0, 1], [1, 2, 2]]
    assert Parallel().instances({NodeType.LINE: 1}).shape == (2, 0)


def test_par_automorphisms() -> None:
    assert automorphisms(Parallel) == ((0, 1), (1, 0))


def test_par_control_error() -> None:
    torch.manual_seed(0)
    first, second = 100 * torch.rand(2, 20, 4)
    assert torch.equal(Parallel().control_error([first, second]), parallel(first, second))
    # A 3-4-5 triangle.
    error = Parallel().control_error([torch.tensor([[0.0, 0, 2, 0]]), torch.tensor([[5.0, 5, 8, 9]])])
    assert error.item() == pytest.approx(0.8)
