"""The bare matrix products that the network needs: what no way of computing it can do without."""

from collections.abc import Mapping
from typing import NamedTuple, final

import torch
from torch import nn

from geoskill.benchmarks.measurement import Work
from geoskill.geometry.primitives import NodeType
from geoskill.model.message_passing import MessagePassing
from geoskill.model.read_out import PerceptronReadOut


@final
class Product(NamedTuple):
    """A matrix ``[rows, inner]`` times one of ``[inner, columns]``."""

    rows: int
    inner: int
    columns: int

    @property
    def operations(self) -> int:
        """Multiplications and additions."""
        return 2 * self.rows * self.inner * self.columns


def needed_products(scorer: MessagePassing, counts: Mapping[NodeType, int], instances: int) -> list[Product]:
    """Those of one frame's scores: of features once, and of the nodes of instances in every step.

    The direct score is left out: what it takes is no part of the network.

    Args:
        scorer: the network.
        counts: features of each type.
        instances: how many.
    """
    hidden, roles = scorer.hidden_dim, scorer.motif.roles
    products = []
    for kind, count in counts.items():
        products += [Product(count, *size) for size in _linear_layers(scorer.encoder.layers[str(kind)])]
        # The first step's states are the features': as source, as destination, and the three gates of the unit.
        products.append(Product(count, hidden, 5 * hidden))
    nodes = len(roles) * instances
    products += [Product(nodes, hidden, 5 * hidden)] * (scorer.steps - 1)
    products += [Product(nodes, hidden, 3 * hidden)] * scorer.steps
    read_out = [Product(instances, *size) for size in _linear_layers(scorer.read_out)]
    if isinstance(scorer.read_out, PerceptronReadOut):  # the first of two layers in every order of the nodes
        return products + read_out[:1] * len(scorer.read_out.orders) + read_out[1:]
    return products + read_out * len(roles)


def _linear_layers(module: nn.Module) -> list[tuple[int, int]]:
    return [(layer.in_features, layer.out_features) for layer in module.modules() if isinstance(layer, nn.Linear)]


def product_work(products: list[Product], device: str, dtype: torch.dtype, times: int = 1) -> Work:
    """Does each of them so many times, with memory that is there already."""
    made = [
        (
            torch.randn(each.rows, each.inner, device=device, dtype=dtype),
            torch.randn(each.inner, each.columns, device=device, dtype=dtype),
            torch.empty(each.rows, each.columns, device=device, dtype=dtype),
        )
        for each in dict.fromkeys(products)
    ]
    of = dict(zip(dict.fromkeys(products), made, strict=True))

    def work() -> None:
        for each in products:
            left, right, out = of[each]
            for _ in range(times):
                torch.mm(left, right, out=out)

    return work
