"""The contract of every built-in kernel, and symmetries of motifs counted by hand."""

import importlib
import inspect
from collections.abc import Sequence
from itertools import combinations
from pathlib import Path
from typing import ClassVar

import pytest
import torch

import geoskill.kernels.kernel
from geoskill.geometry.primitives import NodeType
from geoskill.kernels.kernel import Kernel, automorphisms, directed_edges, node_dim, node_types

POINT, LINE = NodeType.POINT, NodeType.LINE
STEMS = sorted(
    path.stem
    for path in Path(geoskill.kernels.kernel.__file__).parent.glob("*.py")
    if path.stem not in ("__init__", "kernel", "enumeration")
)


def kernels_of(stem: str) -> list[type[Kernel]]:
    module = importlib.import_module(f"geoskill.kernels.{stem}")
    return [
        value
        for value in vars(module).values()
        if inspect.isclass(value) and issubclass(value, Kernel) and value.__module__ == module.__name__
    ]


def test_built_in_kernels_exist() -> None:
    assert {"p2p", "p2l", "l2l", "par", "p2p3", "p2l3", "l2l3", "par3", "p2pl", "copl", "copl2", "p2c"} <= set(STEMS)


@pytest.mark.parametrize("stem", STEMS)
def test_kernel_file_holds_one_final_kernel_of_its_name(stem: str) -> None:
    (kernel,) = kernels_of(stem)
    assert kernel.name == stem
    assert getattr(kernel, "__final__", False)
    assert isinstance(kernel(), Kernel)


@pytest.mark.parametrize("stem", STEMS)
def test_kernel_motif_is_connected_and_without_duplicate_edges(stem: str) -> None:
    (kernel,) = kernels_of(stem)
    nodes = set(range(len(kernel.roles)))
    assert all(isinstance(role, NodeType) for role in kernel.roles)
    assert {node for edge in kernel.edges for node in edge} == nodes  # a node without an edge gets no message
    assert all(i != j for i, j in kernel.edges)
    assert len({frozenset(edge) for edge in kernel.edges}) == len(kernel.edges)
    reached = {0}
    for _ in nodes:
        reached |= {j for i, j in directed_edges(kernel) if i in reached}
    assert reached == nodes


@pytest.mark.parametrize("stem", STEMS)
@pytest.mark.parametrize("points", [0, 1, 2, 5])
@pytest.mark.parametrize("lines", [0, 1, 3])
def test_kernel_instances_are_distinct_and_within_range(stem: str, points: int, lines: int) -> None:
    (kernel,) = kernels_of(stem)
    counts = {kind: points if kind is POINT else lines for kind in NodeType}
    index = kernel().instances(counts)
    assert index.dtype == torch.long
    assert index.shape[0] == len(kernel.roles)
    for role, row in zip(kernel.roles, index, strict=True):
        assert ((row >= 0) & (row < counts[role])).all()
    instances = [tuple(column) for column in index.T.tolist()]
    for instance in instances:
        assert len(set(zip(kernel.roles, instance, strict=True))) == len(instance)  # no feature with itself
    # Listed in the order of every automorphism, no association comes twice.
    orders = [tuple(instance[i] for i in order) for instance in instances for order in automorphisms(kernel)]
    assert len(set(orders)) == len(orders)


@pytest.mark.parametrize("stem", STEMS)
@pytest.mark.parametrize("count", [0, 1, 7])
def test_control_error_shape(stem: str, count: int) -> None:
    (kernel,) = kernels_of(stem)
    torch.manual_seed(0)
    nodes = [100 * torch.rand(count, node_dim(kernel, role)) for role in kernel.roles]
    error = kernel().control_error(nodes)
    assert error.shape == (count, kernel.error_dim)
    assert error.dtype == torch.float32
    assert torch.isfinite(error).all()


@pytest.mark.parametrize("stem", STEMS)
def test_control_error_norm_is_invariant_under_automorphisms(stem: str) -> None:
    (kernel,) = kernels_of(stem)
    torch.manual_seed(0)
    nodes = [100 * torch.rand(50, node_dim(kernel, role), dtype=torch.float64) for role in kernel.roles]
    size = kernel().control_error(nodes).norm(dim=1)
    assert size.min() > 0
    for order in automorphisms(kernel):
        torch.testing.assert_close(kernel().control_error([nodes[i] for i in order]).norm(dim=1), size)


def motif_kernel(kernel_roles: Sequence[NodeType], kernel_edges: Sequence[tuple[int, int]]) -> type[Kernel]:
    """A kernel with a motif only; abstract, since tests ask it for neither instances nor errors."""

    class MotifKernel(Kernel):
        roles: ClassVar[tuple[NodeType, ...]] = tuple(kernel_roles)
        edges: ClassVar[tuple[tuple[int, int], ...]] = tuple(kernel_edges)

    return MotifKernel


PAIR = [(0, 1)]
PATH = [(0, 1), (1, 2)]
RING = [(0, 1), (1, 2), (2, 3), (3, 0)]
COMPLETE = list(combinations(range(4), 2))


@pytest.mark.parametrize(
    ("roles", "edges", "expected"),
    [
        ([POINT, POINT], PAIR, {(0, 1), (1, 0)}),
        ([POINT, LINE], PAIR, {(0, 1)}),
        ([POINT] * 3, PATH, {(0, 1, 2), (2, 1, 0)}),
        ([POINT] * 3, [(1, 0), (2, 1)], {(0, 1, 2), (2, 1, 0)}),  # edges have no direction
        ([POINT, LINE, POINT], PATH, {(0, 1, 2), (2, 1, 0)}),
        ([POINT, POINT, LINE], PATH, {(0, 1, 2)}),
        ([POINT, POINT, LINE], [(0, 2), (1, 2)], {(0, 1, 2), (1, 0, 2)}),
        ([POINT, POINT, LINE, LINE], [(0, 2), (1, 3)], {(0, 1, 2, 3), (1, 0, 3, 2)}),
    ],
)
def test_automorphisms(roles: list[NodeType], edges: list[tuple[int, int]], expected: set[tuple[int, ...]]) -> None:
    orders = automorphisms(motif_kernel(roles, edges))
    assert orders[0] == tuple(range(len(roles)))
    assert set(orders) == expected
    assert len(orders) == len(expected)


@pytest.mark.parametrize(
    ("roles", "edges", "count"),
    [
        ([POINT] * 4, COMPLETE, 24),
        ([POINT] * 4, RING, 8),
        ([POINT, POINT, POINT, LINE], COMPLETE, 6),
        ([POINT, POINT, LINE, LINE], COMPLETE, 4),
        ([POINT, LINE, POINT, LINE], RING, 4),
    ],
)
def test_number_of_automorphisms(roles: list[NodeType], edges: list[tuple[int, int]], count: int) -> None:
    assert len(set(automorphisms(motif_kernel(roles, edges)))) == count


def test_directed_edges_have_both_directions() -> None:
    assert directed_edges(motif_kernel([POINT] * 3, PATH)) == ((0, 1), (1, 2), (1, 0), (2, 1))


def test_node_types_are_distinct_and_in_order() -> None:
    assert node_types(motif_kernel([LINE, POINT, LINE], PATH)) == (LINE, POINT)
    assert node_types(motif_kernel([POINT, POINT], PAIR)) == (POINT,)
