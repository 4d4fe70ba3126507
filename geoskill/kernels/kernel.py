"""The interface of skill kernels: a motif of typed nodes, its instances in a frame, and its control error."""

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from itertools import permutations
from typing import ClassVar

from jaxtyping import Float, Int64
from torch import Tensor

from geoskill.geometry.primitives import NodeType


class Kernel(ABC):
    """A motif, a small undirected graph whose nodes are geometric features (the paper, section III-A).

    A subclass is final, lives in the file of its name, and sets:

    Attributes:
        name: the word on the command line and in files.
        meaning: what the association says, for the readable definition of a skill.
        roles: the type of each of its ``k`` nodes.
        edges: undirected edges between nodes, every edge once.
        error_dim: length ``d`` of the control error, the degrees of freedom that the association constrains.
        unit: unit of the error as printed; empty for an error without unit.
        resolution: smallest change of the error's norm that detection can resolve, in the error's unit; an instance
            that changes by less is at rest.
    """

    name: ClassVar[str]
    meaning: ClassVar[str]
    roles: ClassVar[tuple[NodeType, ...]]
    edges: ClassVar[tuple[tuple[int, int], ...]]
    error_dim: ClassVar[int]
    unit: ClassVar[str] = "px"
    resolution: ClassVar[float]

    @abstractmethod
    def instances(self, counts: Mapping[NodeType, int]) -> Int64[Tensor, "k m"]:
        """List every possible association in a frame with the given number of features of each type.

        Row ``r`` indexes the features of type ``roles[r]``. Associations that differ only by an automorphism of the
        motif are listed once.
        """

    @abstractmethod
    def control_error(self, nodes: Sequence[Float[Tensor, "m _"]]) -> Float[Tensor, "m d"]:
        """Return the control error of ``m`` instances, given the geometry of their nodes in pixels by role."""


def node_types(kernel: type[Kernel] | Kernel) -> tuple[NodeType, ...]:
    """Return the distinct types of a kernel's nodes, in the order in which they first appear."""
    return tuple(dict.fromkeys(kernel.roles))


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
