"""What a member remembers of the end of its demonstration: where the moving features came to lie on their targets."""

from collections.abc import Mapping, Sequence
from typing import final

import torch
from jaxtyping import Bool, Float
from torch import Tensor, nn

from geoskill.geometry.primitives import NodeType
from geoskill.kernels.kernel import Kernel, node_types


@final
class GoalReference(nn.Module):
    """Selected instances of the demonstration with their geometry at its end, and the features around their targets.

    All of it is buffers, so that a checkpoint holds it; they are empty until :meth:`fit`.

    Args:
        kernel: gives the types of the nodes.

    Attributes:
        moving: ``[k]``, which nodes of an instance move, when it is listed with the moving node first.
        tolerance: largest norm of the goal error at which an association is at its goal, in the error's unit.
    """

    moving: Tensor
    tolerance: Tensor

    def __init__(self, kernel: Kernel) -> None:
        super().__init__()
        self._num_nodes = len(kernel.roles)
        self._node_types = node_types(kernel)
        self._names = [
            "moving",
            *(f"node{node}_{part}" for node in range(self._num_nodes) for part in ("descriptor", "end")),
            *(
                f"{node_type}_{group}_{part}"
                for node_type in self._node_types
                for group in ("resting", "carried")
                for part in ("descriptor", "end")
            ),
        ]
        self.register_buffer("moving", torch.zeros(0, dtype=torch.bool))
        self.register_buffer("tolerance", torch.zeros(()))
        for name in self._names[1:]:
            self.register_buffer(name, torch.zeros(0, 0))
        for node_type in self._node_types:
            self.register_buffer(f"{node_type}_similar", torch.zeros(()))

    @property
    def is_fitted(self) -> bool:
        """Whether it has an instance, and its moving and its resting nodes are known."""
        return len(self.moving) > 0 and len(self.node(0)[1]) > 0

    def node(self, node: int) -> tuple[Float[Tensor, "r d"], Float[Tensor, "r g"]]:
        """Return descriptors and geometry at the demonstration's end of one node of every stored instance."""
        return getattr(self, f"node{node}_descriptor"), getattr(self, f"node{node}_end")

    def surroundings(self, node_type: NodeType) -> tuple[Float[Tensor, "t d"], Float[Tensor, "t g"]]:
        """Return descriptors and geometry of the features around the resting nodes at the demonstration's end."""
        return getattr(self, f"{node_type}_resting_descriptor"), getattr(self, f"{node_type}_resting_end")

    def carried(self, node_type: NodeType) -> tuple[Float[Tensor, "t d"], Float[Tensor, "t g"]]:
        """Return descriptors and geometry at the demonstration's end of all features that moved."""
        return getattr(self, f"{node_type}_carried_descriptor"), getattr(self, f"{node_type}_carried_end")

    def similar(self, node_type: NodeType) -> float:
        """Return by how much two descriptors of one feature may differ."""
        return float(getattr(self, f"{node_type}_similar"))

    def fit(
        self,
        moving: Bool[Tensor, " k"],
        nodes: Sequence[tuple[Float[Tensor, "r _"], Float[Tensor, "r _"]]],
        surroundings: Mapping[NodeType, tuple[Float[Tensor, "_ _"], Float[Tensor, "_ _"]]],
        carried: Mapping[NodeType, tuple[Float[Tensor, "_ _"], Float[Tensor, "_ _"]]],
        similar: Mapping[NodeType, float],
    ) -> None:
        """Set what is remembered; the tolerance is set afterwards.

        Args:
            moving: which nodes move; some do, others do not.
            nodes: see :meth:`node`.
            surroundings: see :meth:`surroundings`.
            carried: see :meth:`carried`.
            similar: see :meth:`similar`.
        """
        self.moving = moving.clone()
        for node, (descriptors, ends) in enumerate(nodes):
            setattr(self, f"node{node}_descriptor", descriptors.clone())
            setattr(self, f"node{node}_end", ends.clone())
        for group, features in (("resting", surroundings), ("carried", carried)):
            for node_type, (descriptors, ends) in features.items():
                setattr(self, f"{node_type}_{group}_descriptor", descriptors.clone())
                setattr(self, f"{node_type}_{group}_end", ends.clone())
        for node_type, difference in similar.items():
            setattr(self, f"{node_type}_similar", torch.tensor(difference))

    def set_tolerance(self, tolerance: float) -> None:
        """Set the largest norm of the goal error at the goal."""
        self.tolerance = torch.full_like(self.tolerance, tolerance)

    def _load_from_state_dict(self, state_dict: dict[str, Tensor], prefix: str, *args: object) -> None:
        # The lengths of these buffers depend on the demonstration, so the stored shape rules.
        for name in self._names:
            if prefix + name in state_dict:
                setattr(self, name, getattr(self, name).new_empty(state_dict[prefix + name].shape))
        super()._load_from_state_dict(state_dict, prefix, *args)
