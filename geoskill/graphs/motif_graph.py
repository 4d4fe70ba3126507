"""A frame under one kernel as a PyTorch Geometric graph.

The ``m`` small graphs of a frame share its features, so they are not written out one by one: a frame is one
:class:`MotifGraph` with its features as nodes and one index tensor ``[k, m]`` that says which features each instance
joins. PyTorch Geometric's own ``DataLoader`` batches it.
"""

import copy
from collections.abc import Mapping
from dataclasses import fields
from typing import Any, final

import torch
from jaxtyping import Bool, Float, Int64
from torch import Tensor
from torch_geometric.data import Data

from geoskill.features.feature_set import FeatureSet
from geoskill.geometry.primitives import NodeType
from geoskill.kernels.kernel import Kernel, node_types
from geoskill.tracking.motion import Displacement, Trajectory


@final
class MotifGraph(Data):  # type: ignore[misc]  # PyTorch Geometric's classes have no types
    """The features of one frame and the instances of one kernel on them; build it with :func:`motif_graph`.

    Attributes, for each node type ``T`` of the kernel (``point``, ``line``):
        T_count: ``[1]``, how many there are; in a batch, in each frame.
        T_descriptor: ``[n_T, D_T]``, unit norm.
        T_geometry: ``[n_T, g]``, pixels.
        T_next_geometry, T_tracked: the :class:`Displacement`, in training only.
        T_anchor_xy, T_first_known_anchor, T_final_xy, T_final_known: the :class:`Trajectory`, in training only.

    And for the instances, where there are (:func:`feature_graph`):
        instance_index: ``[k, m]``; row ``r`` indexes the nodes of type ``roles[r]``.
        instance_frame: ``[m]``, zero; in a batch, the number of the frame that an instance belongs to.
        roles: the kernel's node types.
    """

    def __inc__(self, key: str, value: Any, *args: Any, **kwargs: Any) -> Any:
        if key == "instance_index":
            # Each row indexes another type's nodes, so each has its own offset.
            return torch.tensor([[self.node_count(NodeType(role))] for role in self.roles])
        if key == "instance_frame":
            return 1
        return 0

    def __cat_dim__(self, key: str, value: Any, *args: Any, **kwargs: Any) -> int:
        return 1 if key == "instance_index" else 0

    def node_count(self, node_type: NodeType) -> int:
        """Features of this type in the frame."""
        return int(self[f"{node_type}_geometry"].shape[0])


def motif_graph(
    kernel: Kernel,
    features: Mapping[NodeType, FeatureSet],
    displacement: Mapping[NodeType, Displacement] | None = None,
    trajectory: Mapping[NodeType, Trajectory] | None = None,
) -> MotifGraph:
    """The graph of one frame, with every instance.

    Args:
        kernel: gives the node types and the instances.
        features: one feature set for each of the kernel's node types.
        displacement: for each node type, where the features lie in the transition's other frame; for training.
        trajectory: for each node type, where they came from and where they end; for training.
    """
    return with_instances(kernel, feature_graph(kernel, features, displacement, trajectory))


def feature_graph(
    kernel: Kernel,
    features: Mapping[NodeType, FeatureSet],
    displacement: Mapping[NodeType, Displacement] | None = None,
    trajectory: Mapping[NodeType, Trajectory] | None = None,
) -> MotifGraph:
    """The same without instances, to which :func:`with_instances` adds those that are wanted."""
    graph = MotifGraph()
    types = node_types(kernel)
    for node_type in types:
        found = features[node_type]
        graph[f"{node_type}_count"] = torch.tensor([len(found)])
        graph[f"{node_type}_descriptor"] = torch.from_numpy(found.descriptors)
        graph[f"{node_type}_geometry"] = torch.from_numpy(found.geometry)
        for record in (displacement, trajectory):
            if record is not None:
                for field in fields(record[node_type]):
                    graph[f"{node_type}_{field.name}"] = getattr(record[node_type], field.name)
    graph.num_nodes = sum(len(features[node_type]) for node_type in types)
    graph.roles = tuple(str(role) for role in kernel.roles)
    return graph


def with_instances(
    kernel: Kernel, graph: MotifGraph, visible: Mapping[NodeType, Bool[Tensor, " n"]] | None = None
) -> MotifGraph:
    """A copy of a graph, or of a batch of graphs, that has every instance of visible features and no others.

    Features keep their rows. A frame may be left without any instance.

    Args:
        kernel: gives the instances.
        graph: one frame or a batch of frames.
        visible: for each of the kernel's node types, whether a feature is; None for all.
    """
    rows: dict[NodeType, list[Tensor]] = {}
    for kind in node_types(kernel):
        counts = graph[f"{kind}_count"].tolist()
        of_kind = torch.arange(sum(counts), device=graph[f"{kind}_geometry"].device)
        rows[kind] = list(torch.split(of_kind, counts))
        if visible is not None:
            shown = torch.split(visible[kind], counts)
            rows[kind] = [row[seen] for row, seen in zip(rows[kind], shown, strict=True)]
    found = []
    for frame in range(len(rows[kernel.roles[0]])):
        of_frame = {kind: of_kind[frame] for kind, of_kind in rows.items()}
        index = kernel.instances({kind: len(row) for kind, row in of_frame.items()})
        nodes = zip(kernel.roles, index, strict=True)
        found.append(torch.stack([of_frame[role][row.to(of_frame[role].device)] for role, row in nodes]))
    complete = copy.copy(graph)
    complete.instance_index = torch.cat(found, dim=1)
    sizes = torch.tensor([index.shape[1] for index in found], device=complete.instance_index.device)
    complete.instance_frame = torch.arange(len(found), device=sizes.device).repeat_interleave(sizes)
    return complete


def gather_nodes(
    kernel: Kernel, nodes: Mapping[NodeType, Float[Tensor, "n _"]], instance_index: Int64[Tensor, "k m"]
) -> list[Float[Tensor, "m _"]]:
    """For each role of the kernel, the rows of the features that the instances have there."""
    return [nodes[role][row] for role, row in zip(kernel.roles, instance_index, strict=True)]
