"""What is measured: a kernel, a network and a number of features, and the ways to do the work of them."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, final

import torch
from hydra.utils import instantiate
from omegaconf import DictConfig, OmegaConf
from torch import Tensor
from torch.nn.functional import normalize

from geoskill.benchmarks.measurement import Work
from geoskill.benchmarks.plain import PlainNetwork, batch_of_instances
from geoskill.benchmarks.products import needed_products, product_work
from geoskill.cli.command import configuration_folder
from geoskill.geometry.primitives import NodeType
from geoskill.kernels.kernel import Kernel
from geoskill.model.message_passing import PRECISIONS, MessagePassing
from geoskill.model.scorer import InstanceScorer, Motif
from geoskill.objective.selection import select_out

Way = Literal["ours", "cascade", "plain", "products"]
Job = Literal["select_out", "training"]
# SIFT with colors, and the line band descriptor.
DESCRIPTOR_DIMS = {NodeType.POINT: 138, NodeType.LINE: 72}


@final
@dataclass(frozen=True)
class Case:
    """One cell of the table.

    Attributes:
        job: ``select_out`` is the scores of one frame and their softmax; ``training`` is a step of Adam on them.
        kernel: a file of ``conf/kernel``.
        model: a file of ``conf/model``.
        features: of each of the kernel's types.
        device: of PyTorch.
        threads: of PyTorch.
        precision: of ours and of the bare products; the plain network is as anyone would write it, in single precision.
    """

    job: Job
    kernel: str
    model: str
    features: int
    device: str
    threads: int
    precision: str = "float32"

    def ways(self) -> tuple[Way, ...]:
        """Those that there are: only message passing has another way to be written.

        ``ours`` passes messages in all instances, as in training; ``cascade`` in as many as the network's own says,
        where there are more.
        """
        scorer = self.build_scorer()
        if not isinstance(scorer, MessagePassing):
            return ("ours",)
        shorter = self.job == "select_out" and scorer.cascade is not None and scorer.cascade < self.instances()
        return ("ours", *(("cascade",) if shorter else ()), "plain", "products")

    def instances(self) -> int:
        """How many there are."""
        return self.build_kernel().instances(self.counts()).shape[1]

    def build_kernel(self) -> Kernel:
        """The kernel."""
        kernel: Kernel = instantiate(_configured("kernel", self.kernel)[self.kernel])
        return kernel

    def counts(self) -> dict[NodeType, int]:
        """Features of each type."""
        return dict.fromkeys(self.build_kernel().roles, self.features)

    def build_scorer(self) -> InstanceScorer:
        """The network, always with the same weights."""
        torch.manual_seed(0)
        kernel = self.build_kernel()
        settings = _configured("model", self.model)
        if "precision" in settings:
            settings.precision = self.precision
        make = instantiate(settings)
        scorer: InstanceScorer = make(Motif.of(kernel, {kind: DESCRIPTOR_DIMS[kind] for kind in kernel.roles}))
        return scorer.to(self.device)


def precisions_of(model: str) -> tuple[str, ...]:
    """Those that a model can have."""
    return PRECISIONS if "precision" in _configured("model", model) else PRECISIONS[:1]


def _configured(group: str, name: str) -> DictConfig:
    found = OmegaConf.load(Path(configuration_folder()) / group / f"{name}.yaml")
    assert isinstance(found, DictConfig)
    return found


def prepare(case: Case, way: Way) -> Work:
    """The work of a case in one of its ways, with everything made that is there beforehand."""
    torch.set_num_threads(case.threads)
    scorer, counts = case.build_scorer().train(way != "cascade"), case.counts()
    descriptors = {
        kind: normalize(torch.randn(count, DESCRIPTOR_DIMS[kind], device=case.device)) for kind, count in counts.items()
    }
    index = case.build_kernel().instances(counts).to(case.device)
    if way == "products":
        assert isinstance(scorer, MessagePassing)
        # A backward pass has two products for each.
        times = 3 if case.job == "training" else 1
        dtype = getattr(torch, case.precision)
        return product_work(needed_products(scorer, counts, index.shape[1]), case.device, dtype, times)
    if way == "plain":
        assert isinstance(scorer, MessagePassing)
        network, batch = PlainNetwork(scorer), batch_of_instances(scorer, descriptors, index)

        def scores() -> Tensor:
            found: Tensor = network(batch)
            return found
    else:

        def scores() -> Tensor:
            found: Tensor = scorer(descriptors, index)
            return found

    return _work(case.job, scorer, scores, index.shape[1], case.device)


def _work(job: Job, scorer: InstanceScorer, scores: Callable[[], Tensor], count: int, device: str) -> Work:
    frame = torch.zeros(count, dtype=torch.long, device=device)
    # What instances earn; which it is makes no difference to the time.
    earned = torch.linspace(-1.0, 1.0, count, device=device)
    optimizer = torch.optim.Adam(scorer.parameters(), lr=1e-3)

    def frame_work() -> Tensor:
        with torch.no_grad():
            return select_out(scores(), frame, 1)

    def step() -> None:
        optimizer.zero_grad()
        torch.autograd.backward((select_out(scores(), frame, 1) * earned).sum())
        optimizer.step()

    return frame_work if job == "select_out" else step
