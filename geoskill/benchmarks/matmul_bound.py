"""The matrix products that the network cannot do without: a lower bound on its time."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple, final

import torch
from torch import nn

from geoskill.benchmarks.measurement import Workload
from geoskill.geometry.primitives import NodeType
from geoskill.model.message_passing import MessagePassing
from geoskill.model.read_out import PerceptronReadOut


@final
class MatrixProduct(NamedTuple):
    """A matrix ``[rows, inner]`` times one of ``[inner, columns]``."""

    rows: int
    inner: int
    columns: int

    @property
    def operations(self) -> int:
        """Number of multiplications and additions."""
        return 2 * self.rows * self.inner * self.columns


def required_products(scorer: MessagePassing, counts: Mapping[NodeType, int], instances: int) -> list[MatrixProduct]:
    """Return the matrix products that the scores of one frame need, without the prototype score.

    Features are encoded once; the nodes of instances are multiplied in every step.

    Args:
        scorer: the network.
        counts: number of features of each type.
        instances: number of instances.
    """
    hidden, roles = scorer.hidden_dim, scorer.motif.roles
    products = []
    for node_type, count in counts.items():
        products += [MatrixProduct(count, *size) for size in _linear_sizes(scorer.encoder.layers[str(node_type)])]
        # In the first step the states are the features': as source, as destination, and for the three gates.
        products.append(MatrixProduct(count, hidden, 5 * hidden))
    nodes = len(roles) * instances
    products += [MatrixProduct(nodes, hidden, 5 * hidden)] * (scorer.steps - 1)
    products += [MatrixProduct(nodes, hidden, 3 * hidden)] * scorer.steps
    read_out = [MatrixProduct(instances, *size) for size in _linear_sizes(scorer.read_out)]
    if isinstance(scorer.read_out, PerceptronReadOut):  # the first of its two layers runs once per order of the nodes
        return products + read_out[:1] * len(scorer.read_out.orders) + read_out[1:]
    return products + read_out * len(roles)


def _linear_sizes(module: nn.Module) -> list[tuple[int, int]]:
    return [(layer.in_features, layer.out_features) for layer in module.modules() if isinstance(layer, nn.Linear)]


def matmul_workload(
    products: Sequence[MatrixProduct], device: str, dtype: torch.dtype, repetitions: int = 1
) -> Workload:
    """Return a workload that computes every product ``repetitions`` times into memory allocated beforehand."""
    operands = {
        product: (
            torch.randn(product.rows, product.inner, device=device, dtype=dtype),
            torch.randn(product.inner, product.columns, device=device, dtype=dtype),
            torch.empty(product.rows, product.columns, device=device, dtype=dtype),
        )
        for product in dict.fromkeys(products)
    }

    def multiply() -> None:
        for product in products:
            left, right, result = operands[product]
            for _ in range(repetitions):
                torch.mm(left, right, out=result)

    return multiply
