"""The interface of networks that score a kernel's instances, and the motif for which they are built."""

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import ClassVar, final

from jaxtyping import Float, Int64
from torch import Tensor, nn

from geoskill.geometry.primitives import NodeType
from geoskill.kernels.kernel import Kernel, automorphisms, directed_edges


@final
@dataclass(frozen=True)
class Motif:
    """A kernel as a network sees it.

    Attributes:
        roles: the type of each node.
        edges: directed edges as (source, destination); every undirected edge is there in both directions.
        automorphisms: permutations of the nodes that keep types and edges, the identity first.
        descriptor_dims: length of the descriptors of each node type.
        patch_sides: for node types whose descriptors begin with a square patch of pixels, the side of the patch.
    """

    roles: tuple[NodeType, ...]
    edges: tuple[tuple[int, int], ...]
    automorphisms: tuple[tuple[int, ...], ...]
    descriptor_dims: Mapping[NodeType, int]
    patch_sides: Mapping[NodeType, int] = field(default_factory=dict)

    @classmethod
    def of(
        cls,
        kernel: Kernel,
        descriptor_dims: Mapping[NodeType, int],
        patch_sides: Mapping[NodeType, int | None] | None = None,
    ) -> "Motif":
        """Build the motif of a kernel.

        Args:
            kernel: gives nodes, edges and symmetries.
            descriptor_dims: length of the descriptors of each node type.
            patch_sides: side of the patch with which they begin, in pixels; None for types without a patch.
        """
        sides = {node_type: side for node_type, side in (patch_sides or {}).items() if side is not None}
        return cls(kernel.roles, directed_edges(kernel), automorphisms(kernel), dict(descriptor_dims), sides)


class InstanceScorer(nn.Module, ABC):
    """A network that gives each instance of a motif its relevance ``b``, before the softmax (the paper, section III-B).

    The score does not change when an instance's nodes are listed in the order of another automorphism.

    A subclass is final, lives in the file of its name, and sets:

    Attributes:
        name: the name of its file, by which a registry finds it.
    """

    name: ClassVar[str]

    def fit_prototypes(self, descriptors: Mapping[NodeType, Float[Tensor, "n _"]]) -> None:
        """Keep prototypes from all features of the demonstration, before training. Most scorers keep none."""

    @abstractmethod
    def forward(
        self, descriptors: Mapping[NodeType, Float[Tensor, "n _"]], instance_index: Int64[Tensor, "k m"]
    ) -> Float[Tensor, " m"]:
        """Score ``m`` instances.

        Args:
            descriptors: those of all features, by node type.
            instance_index: row ``r`` indexes the descriptors of the type of role ``r``.
        """
