"""What every network that scores associations offers."""

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
    """A kernel as a network sees it: typed nodes, directed edges, symmetries, and the descriptors' dimensions.

    ``patch_sides`` has the node types whose descriptors begin with a square patch of pixels, and its side.
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
        """The motif of a kernel whose nodes are described by so many numbers each."""
        sides = {kind: side for kind, side in (patch_sides or {}).items() if side is not None}
        return cls(kernel.roles, directed_edges(kernel), automorphisms(kernel), dict(descriptor_dims), sides)


class InstanceScorer(nn.Module, ABC):
    """Gives each instance of a motif its relevance ``b``, before the softmax (the paper, section III-B).

    The score does not change when an instance's nodes are listed in the order of another automorphism.
    """

    name: ClassVar[str]

    def fit_prototypes(self, descriptors: Mapping[NodeType, Float[Tensor, "n _"]]) -> None:
        """Keep what it wants of all features of the demonstration, before training. Most want nothing."""

    @abstractmethod
    def forward(
        self, descriptors: Mapping[NodeType, Float[Tensor, "n _"]], instance_index: Int64[Tensor, "k m"]
    ) -> Float[Tensor, " m"]:
        """Scores of ``m`` instances; row ``r`` of the index picks from the descriptors of the type of role ``r``."""
