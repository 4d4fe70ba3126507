import pytest
import torch

from geoskill.errors import InputError
from geoskill.geometry.primitives import NodeType
from geoskill.model.encoder import DescriptorEncoder
from geoskill.model.scorer import Motif

POINT, LINE = NodeType.POINT, NodeType.LINE


def motif(dims: dict[NodeType, int], sides: dict[NodeType, int] | None = None) -> Motif:
    return Motif((POINT, POINT), ((0, 1), (1, 0)), ((0, 1), (1, 0)), dims, sides or {})


def test_each_type_has_its_own_layer_into_one_space() -> None:
    torch.manual_seed(0)
    encoder = DescriptorEncoder(motif({POINT: 16, LINE: 4}), hidden_dim=3)
    descriptors = {POINT: torch.randn(5, 16), LINE: torch.randn(2, 4)}
    hidden = encoder(descriptors)
    # The square roots of 16 and 4 bring components of unit-norm rows to about 1.
    torch.testing.assert_close(hidden[POINT], encoder.layers["point"](4 * descriptors[POINT]))
    torch.testing.assert_close(hidden[LINE], encoder.layers["line"](2 * descriptors[LINE]))
    assert (hidden[POINT].shape, hidden[LINE].shape) == ((5, 3), (2, 3))
    assert sum(parameter.numel() for parameter in encoder.parameters()) == 16 * 3 + 3 + 4 * 3 + 3


def test_a_frame_without_features_of_a_type() -> None:
    assert DescriptorEncoder(motif({POINT: 16}), hidden_dim=3)({POINT: torch.zeros(0, 16)})[POINT].shape == (0, 3)


def test_with_a_width_it_is_a_perceptron() -> None:
    torch.manual_seed(0)
    encoder = DescriptorEncoder(motif({POINT: 16}), hidden_dim=3, width=7)
    x = torch.randn(5, 16)
    first, _, second = encoder.layers["point"]
    expected = second((4 * x @ first.weight.T + first.bias).clamp(min=0))
    torch.testing.assert_close(encoder({POINT: x})[POINT], expected)
    assert first.weight.shape == (7, 16)


def test_a_width_below_one_is_refused() -> None:
    with pytest.raises(InputError, match=r"model\.encoder_dim=0: expected at least 1, or null"):
        DescriptorEncoder(motif({POINT: 16}), hidden_dim=3, width=0)


def test_patches_are_described_by_convolutions_beside_which_the_rest_stands() -> None:
    torch.manual_seed(0)
    encoder = DescriptorEncoder(motif({POINT: 64 + 2, LINE: 5}, {POINT: 8}), hidden_dim=3, width=7)
    x = torch.randn(5, 66)
    description, perceptron = encoder.layers["point"]
    scaled = 66**0.5 * x
    learned = description.network(scaled[:, :64].reshape(5, 1, 8, 8))
    assert learned.shape == (5, 7)
    torch.testing.assert_close(encoder({POINT: x})[POINT], perceptron(torch.cat([learned, scaled[:, 64:]], dim=1)))
    # Rows are rows: a patch is not the same when it is turned.
    turned = torch.cat([x[:, :64].reshape(5, 8, 8).transpose(1, 2).reshape(5, 64), x[:, 64:]], dim=1)
    assert not torch.allclose(encoder({POINT: turned})[POINT], encoder({POINT: x})[POINT], atol=1e-3)
    assert encoder({LINE: torch.randn(2, 5)})[LINE].shape == (2, 3)
    assert encoder({POINT: torch.zeros(0, 66)})[POINT].shape == (0, 3)


def test_a_linear_encoder_takes_patches_as_they_are() -> None:
    encoder = DescriptorEncoder(motif({POINT: 64}, {POINT: 8}), hidden_dim=3)
    x = torch.randn(5, 64)
    torch.testing.assert_close(encoder({POINT: x})[POINT], encoder.layers["point"](8 * x))


def test_a_patch_that_cannot_be_halved_twice_is_refused() -> None:
    with pytest.raises(ValueError, match=r"^patches of 10 pixels; expected a multiple of four$"):
        DescriptorEncoder(motif({POINT: 100}, {POINT: 10}), hidden_dim=3, width=7)
