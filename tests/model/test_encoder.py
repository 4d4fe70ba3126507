import pytest
import torch

from geoskill.errors import InputError
from geoskill.geometry.primitives import NodeType
from geoskill.model.encoder import DescriptorEncoder

POINT, LINE = NodeType.POINT, NodeType.LINE


def test_each_type_has_its_own_layer_into_one_space() -> None:
    torch.manual_seed(0)
    encoder = DescriptorEncoder({POINT: 16, LINE: 4}, hidden_dim=3)
    descriptors = {POINT: torch.randn(5, 16), LINE: torch.randn(2, 4)}
    hidden = encoder(descriptors)
    # The square roots of 16 and 4 bring components of unit-norm rows to about 1.
    torch.testing.assert_close(hidden[POINT], encoder.layers["point"](4 * descriptors[POINT]))
    torch.testing.assert_close(hidden[LINE], encoder.layers["line"](2 * descriptors[LINE]))
    assert (hidden[POINT].shape, hidden[LINE].shape) == ((5, 3), (2, 3))
    assert sum(parameter.numel() for parameter in encoder.parameters()) == 16 * 3 + 3 + 4 * 3 + 3


def test_a_frame_without_features_of_a_type() -> None:
    assert DescriptorEncoder({POINT: 16}, hidden_dim=3)({POINT: torch.zeros(0, 16)})[POINT].shape == (0, 3)


def test_with_a_width_it_is_a_perceptron() -> None:
    torch.manual_seed(0)
    encoder = DescriptorEncoder({POINT: 16}, hidden_dim=3, width=7)
    x = torch.randn(5, 16)
    first, _, second = encoder.layers["point"]
    expected = second((4 * x @ first.weight.T + first.bias).clamp(min=0))
    torch.testing.assert_close(encoder({POINT: x})[POINT], expected)
    assert first.weight.shape == (7, 16)


def test_a_width_below_one_is_refused() -> None:
    with pytest.raises(InputError, match=r"model\.encoder_dim=0: expected at least 1, or null"):
        DescriptorEncoder({POINT: 16}, hidden_dim=3, width=0)
