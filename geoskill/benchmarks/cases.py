"""The cases that are measured, and the variants of the computation that are compared in each."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, final

import torch
from torch import Tensor
from torch.nn.functional import normalize

from geoskill.benchmarks.matmul_bound import matmul_workload, required_products
from geoskill.benchmarks.measurement import Workload
from geoskill.benchmarks.options import build_network, kernel_of, network_arguments
from geoskill.benchmarks.pyg_reference import PygNetwork, instance_batch
from geoskill.geometry.primitives import NodeType
from geoskill.kernels.kernel import Kernel
from geoskill.model.message_passing import PRECISIONS, MessagePassing
from geoskill.model.scorer import InstanceScorer, Motif
from geoskill.objective.selection import select_out

Variant = Literal["dense", "cascade", "pyg", "matmul_bound"]
Job = Literal["select_out", "training"]
# SIFT with colors, and the line band descriptor.
DESCRIPTOR_DIMS = {NodeType.POINT: 138, NodeType.LINE: 72}


@final
@dataclass(frozen=True)
class Case:
    """A job, a kernel, a network and a number of features on one device.

    Attributes:
        job: ``select_out`` computes the scores of one frame and their softmax; ``training`` is one Adam step on them.
        kernel: name of a kernel.
        model: choice of ``model=``.
        features: number of features of each of the kernel's node types.
        device: of PyTorch, ``cpu`` or ``cuda``.
        threads: number of PyTorch's threads.
        precision: of ``dense``, ``cascade`` and ``matmul_bound``; ``pyg`` is always in single precision.
    """

    job: Job
    kernel: str
    model: str
    features: int
    device: str
    threads: int
    precision: str = "float32"

    def variants(self) -> tuple[Variant, ...]:
        """Return the variants of the computation that this case has.

        - ``dense``: the package's own network on all instances, as in training.
        - ``cascade``: the same with messages for the network's ``cascade`` best candidates only; in ``select_out``,
          where a frame has more instances than that.
        - ``pyg``: the message passing written in PyTorch Geometric.
        - ``matmul_bound``: the matrix products that the message passing needs.

        Networks without message passing only have ``dense``.
        """
        scorer = self.build_scorer()
        if not isinstance(scorer, MessagePassing):
            return ("dense",)
        cascaded = self.job == "select_out" and scorer.cascade is not None and scorer.cascade < self.num_instances()
        return ("dense", *(("cascade",) if cascaded else ()), "pyg", "matmul_bound")

    def num_instances(self) -> int:
        """Return the number of instances of one frame."""
        return self.build_kernel().instances(self.feature_counts()).shape[1]

    def build_kernel(self) -> Kernel:
        """Build the kernel."""
        return kernel_of(self.kernel)

    def feature_counts(self) -> dict[NodeType, int]:
        """Return the number of features of each node type."""
        return dict.fromkeys(self.build_kernel().roles, self.features)

    def build_scorer(self) -> InstanceScorer:
        """Build the network, always with the same weights."""
        torch.manual_seed(0)
        kernel = self.build_kernel()
        arguments = network_arguments(self.model)
        if "precision" in arguments:
            arguments["precision"] = self.precision
        motif = Motif.of(kernel, {node_type: DESCRIPTOR_DIMS[node_type] for node_type in kernel.roles})
        return build_network(arguments, motif).to(self.device)


def available_precisions(model: str) -> tuple[str, ...]:
    """Return the precisions that a network supports."""
    return PRECISIONS if "precision" in network_arguments(model) else PRECISIONS[:1]


def prepare(case: Case, variant: Variant) -> Workload:
    """Return the workload of one variant of a case; weights, descriptors and graphs are made here, outside of it.

    This sets the number of PyTorch's threads.
    """
    torch.set_num_threads(case.threads)
    scorer, counts = case.build_scorer().train(variant != "cascade"), case.feature_counts()
    descriptors = {
        node_type: normalize(torch.randn(count, DESCRIPTOR_DIMS[node_type], device=case.device))
        for node_type, count in counts.items()
    }
    index = case.build_kernel().instances(counts).to(case.device)
    if variant == "matmul_bound":
        assert isinstance(scorer, MessagePassing)
        # The backward pass of a product is two products.
        repetitions = 3 if case.job == "training" else 1
        products = required_products(scorer, counts, index.shape[1])
        return matmul_workload(products, case.device, getattr(torch, case.precision), repetitions)
    if variant == "pyg":
        assert isinstance(scorer, MessagePassing)
        network, batch = PygNetwork(scorer), instance_batch(scorer.motif, descriptors, index)

        def compute_scores() -> Tensor:
            scores: Tensor = network(batch)
            return scores
    else:

        def compute_scores() -> Tensor:
            scores: Tensor = scorer(descriptors, index)
            return scores

    return _workload(case.job, scorer, compute_scores, index.shape[1], case.device)


def _workload(
    job: Job, scorer: InstanceScorer, compute_scores: Callable[[], Tensor], count: int, device: str
) -> Workload:
    frame = torch.zeros(count, dtype=torch.long, device=device)
    # The rewards' values make no difference to the time.
    rewards = torch.linspace(-1.0, 1.0, count, device=device)
    optimizer = torch.optim.Adam(scorer.parameters(), lr=1e-3)

    def select_in_frame() -> Tensor:
        with torch.no_grad():
            return select_out(compute_scores(), frame, 1)

    def train_step() -> None:
        optimizer.zero_grad()
        torch.autograd.backward((select_out(compute_scores(), frame, 1) * rewards).sum())
        optimizer.step()

    return select_in_frame if job == "select_out" else train_step
