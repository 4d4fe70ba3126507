import pytest
import torch

from geoskill.errors import InputError
from geoskill.geometry.primitives import NodeType
from geoskill.model.encoder import DescriptorEncoder
from geoskill.model.scorer import Motif

POINT, LINE = NodeType.POINT, NodeType.LINE


def motif(dims: dict[NodeType, int], sides: dict[NodeType, int] | None = None) -> Motif:
    return Motif((POINT, POINT), ((0, 1), (1, 0)), ((0, 1), (1, 0)), dims, sides or {})


def test_linear_encoder_has_one_layer_per_node_type() -> None:
    torch.manual_seed(0)
    encoder = DescriptorEncoder(motif({POINT: 16, LINE: 4}), hidden_dim=3)
    descriptors = {POINT: torch.randn(5, 16), LINE: torch.randn(2, 4)}
    hidden = encoder(descriptors)
    # The square roots of 16 and 4 bring components of unit-norm rows to about 1.
    torch.testing.assert_close(hidden[POINT], encoder.layers["point"](4 * descriptors[POINT]))
    torch.testing.assert_close(hidden[LINE], encoder.layers["line"](2 * descriptors[LINE]))
    assert (hidden[POINT].shape, hidden[LINE].shape) == ((5, 3), (2, 3))
    assert sum(parameter.numel() for parameter in encoder.parameters()) == 16 * 3 + 3 + 4 * 3 + 3


def test_encoder_without_features() -> None:
    assert DescriptorEncoder(motif({POINT: 16}), hidden_dim=3)({POINT: torch.zeros(0, 16)})[POINT].shape == (0, 3)


def test_encoder_with_width_is_a_perceptron() -> None:
    torch.manual_seed(0)
    encoder = DescriptorEncoder(motif({POINT: 16}), hidden_dim=3, width=7)
    x = torch.randn(5, 16)
    first, _, second = encoder.layers["point"]
    expected = second((4 * x @ first.weight.T + first.bias).clamp(min=0))
    torch.testing.assert_close(encoder({POINT: x})[POINT], expected)
    assert first.weight.shape == (7, 16)


def test_encoder_rejects_width_below_one() -> None:
    with pytest.raises(InputError, match=r"^width=0: expected at least 1, or None for a linear encoder$"):
        DescriptorEncoder(motif({POINT: 16}), hidden_dim=3, width=0)


def test_patch_encoder_concatenates_description_and_rest() -> None:
    torch.manual_seed(0)
    encoder = DescriptorEncoder(motif({POINT: 64 + 2, LINE: 5}, {POINT: 8}), hidden_dim=3, width=7)
    x = torch.randn(5, 66)
    description, perceptron = encoder.layers["point"]
    scaled = 66**0.5 * x
    learned = description.network(scaled[:, :64].reshape(5, 1, 8, 8))
    assert learned.shape == (5, 7)
    torch.testing.assert_close(encoder({POINT: x})[POINT], perceptron(torch.cat([learned, scaled[:, 64:]], dim=1)))
    # A transposed patch is described differently.
    transposed = torch.cat([x[:, :64].reshape(5, 8, 8).transpose(1, 2).reshape(5, 64), x[:, 64:]], dim=1)
    assert not torch.allclose(encoder({POINT: transposed})[POINT], encoder({POINT: x})[POINT], atol=1e-3)
    assert encoder({LINE: torch.randn(2, 5)})[LINE].shape == (2, 3)
    assert encoder({POINT: torch.zeros(0, 66)})[POINT].shape == (0, 3)


def test_linear_encoder_uses_patches_as_numbers() -> None:
    encoder = DescriptorEncoder(motif({POINT: 64}, {POINT: 8}), hidden_dim=3)
    x = torch.randn(5, 64)
    torch.testing.assert_close(encoder({POINT: x})[POINT], encoder.layers["point"](8 * x))


def test_patch_description_rejects_side_not_divisible_by_four() -> None:
    with pytest.raises(ValueError, match=r"^side=10: expected a multiple of four pixels$"):
        DescriptorEncoder(motif({POINT: 100}, {POINT: 10}), hidden_dim=3, width=7)
