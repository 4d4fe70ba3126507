"""The two read-outs."""

import pytest
import torch

from geoskill.errors import InputError
from geoskill.geometry.primitives import NodeType
from geoskill.kernels.p2p import PointToPoint
from geoskill.model.read_out import PerceptronReadOut, ProductReadOut, build_read_out
from geoskill.model.scorer import Motif

P2P = Motif.of(PointToPoint(), {NodeType.POINT: 6})


def test_perceptron_read_out_is_the_mean_over_both_orders() -> None:
    torch.manual_seed(0)
    read_out = PerceptronReadOut(P2P, 4)
    a, b = torch.randn(2, 7, 4)
    forward, reversed_ = read_out.network(torch.cat([a, b], dim=1)), read_out.network(torch.cat([b, a], dim=1))
    assert (forward - reversed_).abs().max() > 1e-2  # so the mean is needed
    torch.testing.assert_close(read_out([a, b]), ((forward + reversed_) / 2)[:, 0])
    assert torch.equal(read_out([a, b]), read_out([b, a]))


def test_product_read_out_by_hand() -> None:
    torch.manual_seed(0)
    read_out = ProductReadOut(P2P, 4)
    a, b = torch.randn(2, 7, 4)
    expected = [
        (read_out.source(x) @ read_out.destination(y) + read_out.source(y) @ read_out.destination(x)) / 8**0.5
        for x, y in zip(a, b, strict=True)
    ]
    torch.testing.assert_close(read_out([a, b]), torch.stack(expected))
    torch.testing.assert_close(read_out([a, b]), read_out([b, a]))


def test_product_read_out_is_zero_for_an_unknown_node() -> None:
    """When u and v of a node are zero, no partner gives it a score; the perceptron has no such states."""
    torch.manual_seed(0)
    read_out = ProductReadOut(P2P, 4)
    for perceptron in (read_out.source, read_out.destination):
        for layer in (perceptron[0], perceptron[2]):
            torch.nn.init.zeros_(layer.bias)
    assert read_out([torch.randn(7, 4), torch.zeros(7, 4)]).tolist() == [0.0] * 7


def test_build_read_out_rejects_unknown_name() -> None:
    with pytest.raises(InputError, match=r"^read_out=mean: expected perceptron or product"):
        build_read_out("mean", P2P, 4)
