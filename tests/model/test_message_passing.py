"""Message passing: sizes, precision and memory. Its values are compared with PyTorch Geometric's elsewhere."""

import pytest
import torch

from geoskill.errors import InputError
from geoskill.geometry.primitives import NodeType
from geoskill.kernels.p2p import PointToPoint
from geoskill.model.message_passing import SAVED_BY_READ_OUT, SAVED_PER_STEP, MessageLayer, MessagePassing
from geoskill.model.scorer import Motif

POINT = NodeType.POINT
P2P = Motif.of(PointToPoint(), {POINT: 6})
# A path of three nodes: its directed edges in the order of their destinations.
PATH = [(1, 0), (0, 1), (2, 1), (1, 2)]


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("hidden_dim", 0),
        ("hidden_dim", -1),
        ("layers", 0),
        ("layers", -5),
        ("encoder_dim", 0),
        ("prototypes", 0),
        ("cascade", 0),
    ],
)
def test_message_passing_rejects_sizes_below_one(name: str, value: int) -> None:
    with pytest.raises(InputError, match=rf"^{name}={value}: expected at least 1$"):
        MessagePassing(
            P2P, **({"hidden_dim": 4, "layers": 2, "shared_weights": True, "read_out": "perceptron"} | {name: value})
        )


def test_shared_weights_make_one_layer() -> None:
    scorer = MessagePassing(P2P, hidden_dim=4, layers=3, shared_weights=True, read_out="perceptron")
    assert len(scorer.layers) == 1
    assert scorer.layer(0) is scorer.layer(2)


def test_separate_weights_make_one_layer_per_step() -> None:
    scorer = MessagePassing(P2P, hidden_dim=4, layers=3, shared_weights=False, read_out="perceptron")
    assert len({scorer.layer(step) for step in range(3)}) == 3


def test_next_states_sum_messages_at_a_node() -> None:
    """The middle of a path gets two messages, and the bias of the output layer twice."""
    torch.manual_seed(0)
    layer = MessageLayer(4).double()
    left, middle, right = torch.randn(3, 5, 4, dtype=torch.float64)
    states = torch.stack([left, middle, right])
    fused = layer.fused()
    updated = fused.next_states(states, fused.project(states), PATH)
    both = layer.message(left, middle) + layer.message(right, middle)
    torch.testing.assert_close(updated[1], layer.update(both, middle), rtol=0, atol=1e-12)
    torch.testing.assert_close(updated[0], layer.update(layer.message(middle, left), left), rtol=0, atol=1e-12)


def test_message_is_not_symmetric() -> None:
    torch.manual_seed(0)
    layer = MessageLayer(4)
    a, b = torch.randn(2, 1, 4)
    assert (layer.message(a, b) - layer.message(b, a)).abs().max() > 1e-3


@pytest.mark.parametrize(("steps", "reached"), [(1, False), (2, True)])
def test_message_reach_grows_by_one_edge_per_step(steps: int, reached: bool) -> None:
    """The two ends of a path depend on one another from the second step on."""
    torch.manual_seed(0)
    fused = MessageLayer(4).fused()
    states = start = torch.randn(3, 1, 4, requires_grad=True)
    for _ in range(steps):
        states = fused.next_states(states, fused.project(states), PATH)
    (gradient,) = torch.autograd.grad(states[2].sum(), start)
    assert bool(gradient[0].any()) == reached


def test_message_passing_rejects_unknown_precision() -> None:
    with pytest.raises(InputError, match=r"^precision=half: expected float32 or bfloat16$"):
        MessagePassing(P2P, hidden_dim=4, layers=2, shared_weights=True, read_out="product", precision="half")


def test_double_precision_is_kept() -> None:
    scorer = MessagePassing(
        P2P, hidden_dim=4, layers=2, shared_weights=True, read_out="product", precision="bfloat16"
    ).double()
    scores = scorer({POINT: torch.randn(5, 6, dtype=torch.float64)}, torch.combinations(torch.arange(5)).T)
    assert scores.dtype == torch.float64


@pytest.mark.parametrize("prototypes", [None, 8])
@pytest.mark.parametrize("read_out", ["product", "perceptron"])
def test_bfloat16_rounds_scores_and_gradients_only_a_little(read_out: str, prototypes: int | None) -> None:
    torch.manual_seed(0)
    descriptors = {POINT: torch.nn.functional.normalize(torch.randn(30, 6))}
    index = torch.combinations(torch.arange(30)).T
    results = []
    exact = MessagePassing(P2P, hidden_dim=32, layers=3, shared_weights=True, read_out=read_out, prototypes=prototypes)
    for precision in ("float32", "bfloat16"):
        scorer = MessagePassing(
            P2P,
            hidden_dim=32,
            layers=3,
            shared_weights=True,
            read_out=read_out,
            prototypes=prototypes,
            precision=precision,
            memory_mb=0.2,
        )
        scorer.load_state_dict(exact.state_dict())
        scorer.fit_prototypes(descriptors)
        scores = scorer(descriptors, index)
        assert scores.dtype == torch.float32
        with torch.no_grad():
            without_gradients = scorer(descriptors, index)
        torch.testing.assert_close(without_gradients, scores, rtol=0, atol=1e-4 if precision == "float32" else 0.02)
        gradients = torch.autograd.grad(torch.softmax(scores, dim=0).square().sum(), list(scorer.parameters()))
        assert all(gradient.dtype == torch.float32 for gradient in gradients)
        results.append((scores, torch.cat([gradient.flatten() for gradient in gradients])))
    (expected, expected_gradient), (rounded, rounded_gradient) = results
    assert 0 < (rounded - expected).abs().max() < 0.1 * expected.std()
    assert torch.nn.functional.cosine_similarity(rounded_gradient, expected_gradient, dim=0) > 0.995


@pytest.mark.parametrize("memory_mb", [0, -1])
def test_message_passing_rejects_memory_that_is_not_positive(memory_mb: float) -> None:
    with pytest.raises(InputError, match=rf"^memory_mb={memory_mb}: expected a positive number of MiB$"):
        MessagePassing(P2P, hidden_dim=4, layers=2, shared_weights=True, read_out="product", memory_mb=memory_mb)


@pytest.mark.slow
@pytest.mark.parametrize("memory_mb", [1e-9, 0.01, 0.1])
def test_recomputed_states_give_the_same_gradients(memory_mb: float) -> None:
    """The smallest memory does not hold an instance, the next a few, the last some tens."""
    torch.manual_seed(0)
    descriptors = {POINT: torch.randn(16, 6, dtype=torch.float64, requires_grad=True)}
    index = torch.combinations(torch.arange(16)).T
    kept = MessagePassing(P2P, hidden_dim=8, layers=3, shared_weights=False, read_out="product", prototypes=4).double()
    recomputed = MessagePassing(
        P2P,
        hidden_dim=8,
        layers=3,
        shared_weights=False,
        read_out="product",
        prototypes=4,
        memory_mb=memory_mb,
    ).double()
    recomputed.load_state_dict(kept.state_dict())
    results = []
    for scorer in (kept, recomputed):
        scores = scorer(descriptors, index)
        gradients = torch.autograd.grad(scores.square().sum(), [descriptors[POINT], *scorer.parameters()])
        results.append([scores, *gradients])
    for expected, result in zip(*results, strict=True):
        torch.testing.assert_close(result, expected, rtol=0, atol=1e-10)


@pytest.mark.parametrize("layers", [1, 3, 5])
@pytest.mark.parametrize("precision", ["float32", "bfloat16"])
@pytest.mark.parametrize("read_out", ["product", "perceptron"])
def test_saved_bytes_are_within_the_assumed_bounds(read_out: str, precision: str, layers: int) -> None:
    """The bounds decide whether states are computed again; the one of the read-out is loose for some read-outs."""
    scorer = MessagePassing(
        P2P, hidden_dim=64, layers=layers, shared_weights=True, read_out=read_out, precision=precision
    )
    index = torch.combinations(torch.arange(60)).T
    state = {"float32": 4, "bfloat16": 2}[precision] * 64 * 2 * index.shape[1]
    kept = _kept_bytes(scorer, index)
    assert 6.0 * layers + 2 < kept / state < SAVED_PER_STEP * layers + SAVED_BY_READ_OUT


@pytest.mark.slow
def test_memory_limit_bounds_saved_bytes() -> None:
    scorer = MessagePassing(P2P, hidden_dim=64, layers=4, shared_weights=True, read_out="product", memory_mb=4)
    few, many = (_kept_bytes(scorer, torch.combinations(torch.arange(count)).T) for count in (60, 240))
    assert many < 2 * few


def _kept_bytes(scorer: MessagePassing, index: torch.Tensor) -> int:
    """Return the size of all storages that autograd keeps for the backward pass, without weights and indices."""
    kept: dict[int, int] = {}

    def pack(tensor: torch.Tensor) -> torch.Tensor:
        if tensor.is_floating_point():
            kept[tensor.untyped_storage().data_ptr()] = tensor.untyped_storage().nbytes()
        return tensor

    descriptors = {POINT: torch.randn(int(index.max()) + 1, 6)}
    with torch.autograd.graph.saved_tensors_hooks(pack, lambda tensor: tensor):
        scores = scorer(descriptors, index)
    assert scores.requires_grad
    return sum(kept.values())
