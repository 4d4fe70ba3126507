"""The variants that are compared do the same work."""

import pytest
import torch
from torch.nn.functional import normalize
from torch.utils.flop_counter import FlopCounterMode

from geoskill.benchmarks.cases import Case, available_precisions, prepare
from geoskill.benchmarks.matmul_bound import required_products
from geoskill.benchmarks.options import PRESETS, build_network, kernel_of, network_arguments
from geoskill.benchmarks.pyg_reference import PygNetwork, instance_batch
from geoskill.errors import InputError
from geoskill.geometry.primitives import NodeType
from geoskill.kernels.kernel import Kernel
from geoskill.kernels.l2l import LineToLine
from geoskill.kernels.p2l import PointToLine
from geoskill.kernels.p2p import PointToPoint
from geoskill.model.message_passing import MessagePassing
from geoskill.model.scorer import Motif

DIMS = {NodeType.POINT: 12, NodeType.LINE: 9}
KERNELS = [PointToPoint(), PointToLine(), LineToLine()]


def network(kernel: Kernel, read_out: str, prototypes: int | None = None, hidden_dim: int = 16) -> MessagePassing:
    torch.manual_seed(0)
    return MessagePassing(
        Motif.of(kernel, {node_type: DIMS[node_type] for node_type in kernel.roles}),
        hidden_dim=hidden_dim,
        layers=3,
        shared_weights=True,
        read_out=read_out,
        prototypes=prototypes,
    )


@pytest.mark.parametrize("kernel", KERNELS, ids=lambda kernel: kernel.name)
@pytest.mark.parametrize(("read_out", "prototypes"), [("perceptron", None), ("product", 5)])
def test_pyg_batch_gives_the_same_scores_and_gradients(kernel: Kernel, read_out: str, prototypes: int | None) -> None:
    scorer = network(kernel, read_out, prototypes).double()
    descriptors = {
        node_type: normalize(torch.randn(7, DIMS[node_type], dtype=torch.float64)) for node_type in kernel.roles
    }
    scorer.fit_prototypes(descriptors)
    index = kernel.instances(dict.fromkeys(kernel.roles, 7))
    batch = instance_batch(scorer.motif, descriptors, index)
    assert batch.num_graphs == index.shape[1]
    results = []
    for scores in (scorer(descriptors, index), PygNetwork(scorer)(batch)):
        results.append([scores, *torch.autograd.grad(scores.square().sum(), list(scorer.parameters()))])
    for dense, pyg in zip(*results, strict=True):
        torch.testing.assert_close(dense, pyg, rtol=0, atol=1e-9)


@pytest.mark.parametrize("kernel", KERNELS, ids=lambda kernel: kernel.name)
@pytest.mark.parametrize("read_out", ["perceptron", "product"])
def test_required_products_match_the_counted_operations(kernel: Kernel, read_out: str) -> None:
    """The dense network may only add one product of weights per step, whose size does not depend on the instances."""
    scorer, count = network(kernel, read_out), 40
    counts = dict.fromkeys(kernel.roles, count)
    descriptors = {node_type: torch.randn(count, DIMS[node_type]) for node_type in kernel.roles}
    index = kernel.instances(counts)
    with FlopCounterMode(display=False) as counter, torch.no_grad():
        scorer(descriptors, index)
    required = sum(product.operations for product in required_products(scorer, counts, index.shape[1]))
    weight_product = scorer.steps * 2 * (3 * 16 * 16 * 16 + 16 * 3 * 16)
    assert required <= counter.get_total_flops() <= required + 4 * weight_product


@pytest.mark.slow
@pytest.mark.parametrize("job", ["select_out", "training"])
@pytest.mark.parametrize(
    ("model", "precision"),
    [("default", "float32"), ("default", "bfloat16"), ("bilinear", "float32"), ("prototypes", "float32")],
)
def test_workloads_are_repeatable(job: str, model: str, precision: str) -> None:
    case = Case(job, "p2p", model, 5, "cpu", torch.get_num_threads(), precision)  # type: ignore[arg-type]
    assert available_precisions(model) == (("float32", "bfloat16") if model == "default" else ("float32",))
    assert case.num_instances() == 10
    assert case.variants() == (("dense", "pyg", "matmul_bound") if model == "default" else ("dense",))
    for variant in case.variants():
        workload = prepare(case, variant)
        first, second = workload(), workload()
        if job == "select_out" and variant != "matmul_bound":
            assert isinstance(first, torch.Tensor)
            assert isinstance(second, torch.Tensor)
            assert float(first.sum()) == pytest.approx(1)
            assert torch.equal(first, second)


@pytest.mark.slow
def test_networks_are_those_of_the_configuration() -> None:
    assert set(PRESETS) == {"default", "paper", "bilinear", "prototypes"}
    names = {preset: network_arguments(preset)["name"] for preset in PRESETS}
    assert names == {
        "default": "message_passing",
        "paper": "message_passing",
        "bilinear": "bilinear",
        "prototypes": "prototypes",
    }
    assert network_arguments("default") != network_arguments("paper")
    motif = Motif.of(PointToPoint(), {NodeType.POINT: 12})
    for preset in PRESETS:
        assert type(build_network(network_arguments(preset), motif)).name == names[preset]
    with pytest.raises(InputError, match=r"^models=large: expected some of default, paper, bilinear, prototypes$"):
        network_arguments("large")


def test_kernels_are_those_of_the_registry() -> None:
    assert [type(kernel_of(name)) for name in ("p2p", "l2l", "p2l")] == [PointToPoint, LineToLine, PointToLine]
    with pytest.raises(InputError, match=r"^kernel=p2q: no such kernel; expected one of "):
        kernel_of("p2q")
