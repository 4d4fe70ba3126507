import pytest
import torch

from geoskill.errors import InputError
from geoskill.geometry.primitives import NodeType
from geoskill.kernels.p2l import PointToLine
from geoskill.model.bilinear import Bilinear
from geoskill.model.scorer import Motif

POINT, LINE = NodeType.POINT, NodeType.LINE


def test_bilinear_scores_by_hand() -> None:
    torch.manual_seed(0)
    path = Motif((POINT, LINE, POINT), ((0, 1), (1, 2), (1, 0), (2, 1)), ((0, 1, 2), (2, 1, 0)), {POINT: 6, LINE: 9})
    network = Bilinear(path, hidden_dim=4).double()
    descriptors = {POINT: torch.randn(3, 6, dtype=torch.float64), LINE: torch.randn(2, 9, dtype=torch.float64)}
    index = torch.tensor([[0, 1, 2, 2], [0, 0, 1, 1], [1, 2, 0, 2]])

    def encoded(encoders: torch.nn.ModuleDict, node_type: NodeType, feature: int) -> torch.Tensor:
        first, _, second = encoders.layers[str(node_type)]
        x = descriptors[node_type][feature] * {POINT: 6, LINE: 9}[node_type] ** 0.5
        return second.weight @ (first.weight @ x + first.bias).clamp(min=0) + second.bias

    expected = []
    for instance in index.T.tolist():
        score = torch.zeros((), dtype=torch.float64)
        for i, j in ((0, 1), (1, 0), (1, 2), (2, 1)):
            source = encoded(network.source, path.roles[i], instance[i])
            destination = encoded(network.destination, path.roles[j], instance[j])
            for a, b in zip(source, destination, strict=True):
                score = score + a * b
        expected.append(score / 2)  # the root of hidden_dim
    torch.testing.assert_close(network(descriptors, index), torch.stack(expected), rtol=0, atol=1e-12)


@pytest.mark.parametrize("hidden_dim", [0, -3])
def test_bilinear_rejects_hidden_dim_below_one(hidden_dim: int) -> None:
    motif = Motif.of(PointToLine(), {POINT: 6, LINE: 9})
    with pytest.raises(InputError, match=rf"^hidden_dim={hidden_dim}: expected at least 1$"):
        Bilinear(motif, hidden_dim=hidden_dim)
