"""The interface of skill kernels: a motif of typed nodes, its instances in a frame, and its control error."""

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from itertools import permutations
from typing import ClassVar

import torch
from jaxtyping import Bool, Float, Int64
from torch import Tensor

from geoskill.geometry.primitives import NodeType
from geoskill.geometry.segments import directed, direction


class Kernel(ABC):
    """A motif, a small undirected graph whose nodes are geometric features (the paper, section III-A).

    A subclass is final, lives in the file of its name, and sets:

    Attributes:
        name: the word on the command line and in files.
        meaning: what the association says, for the readable definition of a skill.
        leaves_free: motions that it leaves free when it holds in space, for the same; empty where that is not said.
        roles: the type of each of its ``k`` nodes.
        edges: undirected edges between nodes, every edge once.
        error_dim: length ``d`` of the control error.
        rank: the degrees of freedom that the association constrains, where these are fewer than the rows of its error.
        in_space: whether the control error is that of features in space, for which pictures need depth, in place of
            their geometry in the picture.
        error_rows: names of the rows of the error; empty for numbers.
        unit: unit of the error as printed; empty for an error without unit.
        resolution: smallest change of the error's norm that detection can resolve, in the error's unit; an instance
            that changes by less is at rest.
    """

    name: ClassVar[str]
    meaning: ClassVar[str]
    leaves_free: ClassVar[str] = ""
    roles: ClassVar[tuple[NodeType, ...]]
    edges: ClassVar[tuple[tuple[int, int], ...]]
    error_dim: ClassVar[int]
    error_rows: ClassVar[tuple[str, ...]] = ()
    rank: ClassVar[int | None] = None
    in_space: ClassVar[bool] = False
    unit: ClassVar[str] = "px"
    resolution: ClassVar[float]

    @abstractmethod
    def instances(self, counts: Mapping[NodeType, int]) -> Int64[Tensor, "k m"]:
        """List every possible association in a frame with the given number of features of each type.

        Row ``r`` indexes the features of type ``roles[r]``. Associations that differ only by an automorphism of the
        motif are listed once.
        """

    def proposals(self, places: Mapping[NodeType, Float[Tensor, "n s"]]) -> Int64[Tensor, "k m"]:
        """List the associations that are worth a score among features at these places in space: mostly all.

        A kernel with too many of them chooses; :meth:`instances` is not asked then. All places are finite.
        """
        return self.instances({node_type: len(rows) for node_type, rows in places.items()})

    @abstractmethod
    def control_error(self, nodes: Sequence[Float[Tensor, "m _"]]) -> Float[Tensor, "m d"]:
        """Return the control error of ``m`` instances, given their nodes by role.

        In pixels of the picture, or in meters of the camera's frame for a kernel :attr:`in_space`
        (:mod:`geoskill.geometry.primitives`).
        """


def node_types(kernel: type[Kernel] | Kernel) -> tuple[NodeType, ...]:
    """Return the distinct types of a kernel's nodes, in the order in which they first appear."""
    return tuple(dict.fromkeys(kernel.roles))


def node_dim(kernel: type[Kernel] | Kernel, node_type: NodeType) -> int:
    """Return the number of coordinates of a node that a kernel's control error is given."""
    return node_type.space_dim if kernel.in_space else node_type.geometry_dim


def constrained_freedom(kernel: type[Kernel] | Kernel) -> int:
    """Return the degrees of freedom that an association of a kernel constrains."""
    return kernel.error_dim if kernel.rank is None else kernel.rank


def instances_in_space(kernel: Kernel, places: Mapping[NodeType, Float[Tensor, "n s"]]) -> Int64[Tensor, "k m"]:
    """Return the proposals of a kernel among features in space, those whose depth is not known (NaN) left out."""
    known = {node_type: rows.isfinite().all(dim=1).nonzero().squeeze(1) for node_type, rows in places.items()}
    index = kernel.proposals({node_type: places[node_type][rows] for node_type, rows in known.items()})
    return torch.stack([known[role][row] for role, row in zip(kernel.roles, index, strict=True)])


def error_row_names(kernel: type[Kernel] | Kernel) -> tuple[str, ...]:
    """Return a name for each row of a kernel's error, such as ``x`` and ``y`` of p2p; numbers where it has none."""
    return kernel.error_rows or tuple(str(row) for row in range(1, kernel.error_dim + 1))


def reference_line(kernel: type[Kernel] | Kernel) -> int | None:
    """Return the node whose direction decides the sign of the error, or None without a line.

    It is the last line. Where nodes are listed with the moving one first, that is the resting line of two.
    """
    lines = [node for node, role in enumerate(kernel.roles) if role is NodeType.LINE]
    return lines[-1] if lines else None


def directed_nodes(
    kernel: type[Kernel] | Kernel, nodes: Sequence[Float[Tensor, "m _"]], axis: Float[Tensor, "#m 2"]
) -> list[Float[Tensor, "m _"]]:
    """Return the nodes of instances with all segments directed, so that no detector decides the sign of the error.

    The reference line is directed by the axis, and every other line by the reference line (:func:`directed`).

    Args:
        kernel: gives the types of the nodes.
        nodes: their geometry in pixels, by role.
        axis: a direction in the picture, of any length but 0.
    """
    reference = reference_line(kernel)
    if reference is None:
        return list(nodes)
    line = directed(nodes[reference], axis)
    along = direction(line)
    return [
        line if node == reference else directed(rows, along) if kernel.roles[node] is NodeType.LINE else rows
        for node, rows in enumerate(nodes)
    ]


def turned_lines(
    before: Sequence[Float[Tensor, "m _"]], after: Sequence[Float[Tensor, "m _"]]
) -> list[Bool[Tensor, " m"]]:
    """Return, for each node, which of its segments :func:`directed_nodes` turned round."""
    return [(own != other).any(dim=1) for own, other in zip(before, after, strict=True)]


def directed_edges(kernel: type[Kernel] | Kernel) -> tuple[tuple[int, int], ...]:
    """Return every edge in both directions as (source, destination), along which messages are passed."""
    return tuple(kernel.edges) + tuple((j, i) for i, j in kernel.edges)


def automorphisms(kernel: type[Kernel] | Kernel) -> tuple[tuple[int, ...], ...]:
    """Return the permutations of a motif's nodes that keep types and edges, the identity first.

    The motif is undirected, so the score of an instance must be the same for all of these orders of its nodes (design
    choice 3, docs/design-choices.md). For p2p they are (0, 1) and (1, 0); for p2l only (0, 1).
    """
    edges = {frozenset(edge) for edge in kernel.edges}
    return tuple(
        order
        for order in permutations(range(len(kernel.roles)))
        if all(kernel.roles[i] == kernel.roles[j] for i, j in enumerate(order))
        and {frozenset((order[i], order[j])) for i, j in kernel.edges} == edges
    )
