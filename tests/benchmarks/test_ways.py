"""The ways that are compared do the same work."""

from pathlib import Path

import pytest
import torch
from torch.nn.functional import normalize
from torch.utils.flop_counter import FlopCounterMode

from geoskill.benchmarks.cases import Case, precisions_of, prepare
from geoskill.benchmarks.plain import PlainNetwork, batch_of_instances
from geoskill.benchmarks.products import needed_products
from geoskill.cli.command import configuration_folder
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
        Motif.of(kernel, {kind: DIMS[kind] for kind in kernel.roles}),
        hidden_dim=hidden_dim,
        layers=3,
        shared_weights=True,
        read_out=read_out,
        prototypes=prototypes,
    )


@pytest.mark.parametrize("kernel", KERNELS, ids=lambda kernel: kernel.name)
@pytest.mark.parametrize(("read_out", "prototypes"), [("perceptron", None), ("product", 5)])
def test_the_plain_network_gives_the_same_scores_and_gradients(
    kernel: Kernel, read_out: str, prototypes: int | None
) -> None:
    scorer = network(kernel, read_out, prototypes).double()
    known = {kind: normalize(torch.randn(7, DIMS[kind], dtype=torch.float64)) for kind in kernel.roles}
    scorer.fit_prototypes(known)
    index = kernel.instances(dict.fromkeys(kernel.roles, 7))
    batch = batch_of_instances(scorer, known, index)
    assert batch.num_graphs == index.shape[1]
    results = []
    for scores in (scorer(known, index), PlainNetwork(scorer)(batch)):
        results.append([scores, *torch.autograd.grad(scores.square().sum(), list(scorer.parameters()))])
    for ours, plain in zip(*results, strict=True):
        torch.testing.assert_close(ours, plain, rtol=0, atol=1e-9)


@pytest.mark.parametrize("kernel", KERNELS, ids=lambda kernel: kernel.name)
@pytest.mark.parametrize("read_out", ["perceptron", "product"])
def test_the_products_are_those_of_the_network(kernel: Kernel, read_out: str) -> None:
    """Counted by PyTorch. Beyond them ours has one of weights in each step, which does not grow with the instances."""
    scorer, count = network(kernel, read_out), 40
    counts = dict.fromkeys(kernel.roles, count)
    descriptors = {kind: torch.randn(count, DIMS[kind]) for kind in kernel.roles}
    index = kernel.instances(counts)
    with FlopCounterMode(display=False) as counted, torch.no_grad():
        scorer(descriptors, index)
    needed = sum(product.operations for product in needed_products(scorer, counts, index.shape[1]))
    of_weights = scorer.steps * 2 * (3 * 16 * 16 * 16 + 16 * 3 * 16)
    assert needed <= counted.get_total_flops() <= needed + 4 * of_weights


@pytest.mark.parametrize("job", ["select_out", "training"])
@pytest.mark.parametrize(
    ("model", "precision"),
    [("default", "float32"), ("default", "bfloat16"), ("bilinear", "float32"), ("prototypes", "float32")],
)
def test_every_way_can_be_done_again_and_again(job: str, model: str, precision: str) -> None:
    case = Case(job, "p2p", model, 5, "cpu", torch.get_num_threads(), precision)  # type: ignore[arg-type]
    assert precisions_of(model) == (("float32", "bfloat16") if model == "default" else ("float32",))
    assert case.instances() == 10
    assert case.ways() == (("ours", "plain", "products") if model == "default" else ("ours",))
    for way in case.ways():
        work = prepare(case, way)
        first, second = work(), work()
        if job == "select_out" and way != "products":
            assert isinstance(first, torch.Tensor)
            assert isinstance(second, torch.Tensor)
            assert float(first.sum()) == pytest.approx(1)
            assert torch.equal(first, second)


def test_the_models_are_those_of_the_configuration() -> None:
    names = {path.stem for path in (Path(configuration_folder()) / "model").glob("*.yaml")}
    assert names >= {"default", "paper", "bilinear", "prototypes"}
