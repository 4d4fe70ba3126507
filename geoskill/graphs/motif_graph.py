"""A frame under one kernel as a PyTorch Geometric graph.

The ``m`` small graphs of a frame share its features, so they are not written out one by one: a frame is one
:class:`MotifGraph` with its features as nodes and one index tensor ``[k, m]`` with the features of every instance.
PyTorch Geometric's own ``DataLoader`` batches it.
"""

import copy
from collections.abc import Mapping
from dataclasses import fields
from itertools import accumulate
from typing import Any, final

import torch
from jaxtyping import Bool, Float, Int64
from torch import Tensor
from torch_geometric.data import Data

from geoskill.features.feature_set import FeatureSet
from geoskill.geometry.primitives import NodeType
from geoskill.kernels.kernel import Kernel, instances_in_space, node_types
from geoskill.tracking.motion import Displacement, Trajectory


@final
class MotifGraph(Data):  # type: ignore[misc]  # PyTorch Geometric's classes have no types
    """The features of one frame and the instances of one kernel on them; build it with :func:`motif_graph`.

    Attributes, for each node type ``T`` of the kernel (``point``, ``line``):
        T_count: ``[1]``, the number of features; in a batch, that of each frame.
        T_descriptor: ``[n_T, D_T]``, unit norm.
        T_geometry: ``[n_T, g]``, pixels.
        T_space: ``[n_T, s]``, meters; NaN where the depth is not known. Only where features were lifted, as below.
        T_space_covariance: ``[n_T, s, s]``, square meters.
        T_next_geometry, T_tracked, T_next_space: the :class:`Displacement`, in training only.
        T_anchor_xy, T_first_known_anchor, T_final_xy, T_final_known, T_part: the :class:`Trajectory`, in training only.
        T_anchor_space, T_final_space: the same in space.

    And for the instances, unless the graph has none yet (:func:`feature_graph`):
        instance_index: ``[k, m]``; row ``r`` indexes the nodes of type ``roles[r]``.
        instance_frame: ``[m]``, zero; in a batch, the number of the frame that an instance belongs to.
        roles: the kernel's node types.
    """

    def __inc__(self, key: str, value: Any, *args: Any, **kwargs: Any) -> Any:
        if key == "instance_index":
            # Every row indexes the nodes of its own type, and so has its own offset.
            return torch.tensor([[self.node_count(NodeType(role))] for role in self.roles])
        if key == "instance_frame":
            return 1
        return 0

    def __cat_dim__(self, key: str, value: Any, *args: Any, **kwargs: Any) -> int:
        return 1 if key == "instance_index" else 0

    def node_count(self, node_type: NodeType) -> int:
        """Return the number of features of a type, in all frames of a batch."""
        return int(self[f"{node_type}_geometry"].shape[0])


def motif_graph(
    kernel: Kernel,
    features: Mapping[NodeType, FeatureSet],
    displacement: Mapping[NodeType, Displacement] | None = None,
    trajectory: Mapping[NodeType, Trajectory] | None = None,
) -> MotifGraph:
    """Build the graph of one frame, with every instance.

    Args:
        kernel: gives the node types and the instances.
        features: one feature set for each of the kernel's node types.
        displacement: for each node type, positions in the transition's other frame; for training.
        trajectory: for each node type, past positions and those at the end; for training.
    """
    return with_instances(kernel, feature_graph(kernel, features, displacement, trajectory))


def feature_graph(
    kernel: Kernel,
    features: Mapping[NodeType, FeatureSet],
    displacement: Mapping[NodeType, Displacement] | None = None,
    trajectory: Mapping[NodeType, Trajectory] | None = None,
) -> MotifGraph:
    """Build the same graph without instances, which :func:`with_instances` can add."""
    graph = MotifGraph()
    types = node_types(kernel)
    for node_type in types:
        feature_set = features[node_type]
        graph[f"{node_type}_count"] = torch.tensor([len(feature_set)])
        graph[f"{node_type}_descriptor"] = torch.from_numpy(feature_set.descriptors)
        graph[f"{node_type}_geometry"] = torch.from_numpy(feature_set.geometry)
        if feature_set.space is not None and feature_set.space_covariance is not None:
            graph[f"{node_type}_space"] = torch.from_numpy(feature_set.space)
            graph[f"{node_type}_space_covariance"] = torch.from_numpy(feature_set.space_covariance)
        for record in (displacement, trajectory):
            if record is not None:
                for field in fields(record[node_type]):
                    value = getattr(record[node_type], field.name)
                    if value is not None:
                        graph[f"{node_type}_{field.name}"] = value
    graph.num_nodes = sum(len(features[node_type]) for node_type in types)
    graph.roles = tuple(str(role) for role in kernel.roles)
    return graph


def with_instances(kernel: Kernel, graph: MotifGraph) -> MotifGraph:
    """Return a copy of a graph, or of a batch of graphs, with every instance of its features.

    A frame may be left without any instance. For a kernel in space, a feature without depth has none.
    """
    types = node_types(kernel)
    counts = [graph[f"{node_type}_count"].tolist() for node_type in types]
    starts = {node_type: [0, *accumulate(own)] for node_type, own in zip(types, counts, strict=True)}
    device = graph[f"{types[0]}_geometry"].device
    index_by_frame = []
    for frame, frame_counts in enumerate(zip(*counts, strict=True)):
        if kernel.in_space:
            places = {kind: graph[f"{kind}_space"][starts[kind][frame] : starts[kind][frame + 1]] for kind in types}
            index = instances_in_space(kernel, {kind: rows.cpu() for kind, rows in places.items()})
        else:
            index = kernel.instances(dict(zip(types, frame_counts, strict=True)))
        index_by_frame.append(index + torch.tensor([[starts[role][frame]] for role in kernel.roles]))
    complete = copy.copy(graph)
    complete.instance_index = torch.cat(index_by_frame, dim=1).to(device)
    sizes = torch.tensor([index.shape[1] for index in index_by_frame], device=device)
    complete.instance_frame = torch.arange(len(index_by_frame), device=device).repeat_interleave(sizes)
    return complete


def take_features(graph: MotifGraph, chosen: Mapping[NodeType, Bool[Tensor, " n"]]) -> MotifGraph:
    """Return a graph, or a batch of graphs, with these of its features only; instances are to be added afterwards.

    A batch cannot be taken apart into its graphs any more: PyTorch Geometric's record of where each begins is of the
    features before.

    Args:
        graph: one frame or a batch of frames, without instances.
        chosen: for each node type of the kernel, whether a feature is kept. Those that are keep their order.
    """
    reduced = copy.copy(graph)
    for outdated in {"batch", "ptr"} & set(graph.keys()):
        del reduced[outdated]
    for node_type, mask in chosen.items():
        counts, rows = graph[f"{node_type}_count"], mask.nonzero().squeeze(1)
        if len(rows) == len(mask):
            continue  # nothing is left out, and copies would take longer than the graph
        frames = torch.arange(len(counts), device=mask.device).repeat_interleave(counts)
        reduced[f"{node_type}_count"] = frames[rows].bincount(minlength=len(counts))
        for key in list(graph.keys()):  # the names of its attributes
            if key.startswith(f"{node_type}_") and key != f"{node_type}_count":
                reduced[key] = graph[key].index_select(0, rows)
    reduced.num_nodes = sum(int(reduced[f"{node_type}_count"].sum()) for node_type in chosen)
    return reduced


def gather_nodes(
    kernel: Kernel, nodes: Mapping[NodeType, Float[Tensor, "n ..."]], instance_index: Int64[Tensor, "k m"]
) -> list[Float[Tensor, "m ..."]]:
    """Return, for each role of the kernel, one row of ``nodes`` per instance: that of its feature in the role."""
    return [nodes[role][row] for role, row in zip(kernel.roles, instance_index, strict=True)]
