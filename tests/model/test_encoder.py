import torch

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
