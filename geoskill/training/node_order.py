"""Fit of the order of nodes that a motif does not tell apart, which decides the sign of the control error."""

import torch
from torch import Tensor

from geoskill.config import ObjectiveConfig
from geoskill.data.transitions import Transitions
from geoskill.geometry.primitives import NodeType
from geoskill.graphs.motif_graph import MotifGraph
from geoskill.kernels.kernel import automorphisms
from geoskill.model.kernel_model import KernelModel
from geoskill.objective.reward import error_change, reward
from geoskill.training.error_changes import error_changes

# Change of place in a picture that detection resolves.
RESOLUTION_PX = 1.0
# Least assumed noise, over a descriptor's norm: without noise, few features would have no unique solution.
MIN_NOISE = 0.1


def fit_node_order(
    members: dict[str, KernelModel],
    demonstration: Transitions,
    objective: ObjectiveConfig,
    descriptor_noise: float,
) -> None:
    """Fit each member's ``node_order``, by which :meth:`KernelModel.moving_node_first` orders an association's nodes.

    This is a linear regression: for the two nodes of an instance that came closer, w·(f_i - f_j) is to be the
    difference of the distances that they moved over the sum of these, weighted by the reward that the instance earned.
    The sum of squares is taken in expectation over noise on the descriptors, since they differ in another video, which
    makes it a ridge regression. The reward scale must be fitted. A member without any rewarded instance stays as it is.

    Args:
        members: by name; those whose motif tells its nodes apart stay as they are.
        demonstration: the transitions.
        objective: gives the measure of change that is rewarded.
        descriptor_noise: norm of the noise over the norm of a descriptor.
    """
    noise = max(descriptor_noise, MIN_NOISE)
    for name, member in members.items():
        equivalent_nodes = sorted({order[0] for order in automorphisms(member.kernel)} - {0})
        if not equivalent_nodes:
            continue
        role = member.kernel.roles[0]
        width = demonstration.graph_without_negatives(name, 0)[f"{role}_descriptor"].shape[1]
        moments, products, total = torch.zeros(width, width), torch.zeros(width), 0.0
        for index in range(len(demonstration)):
            graph = demonstration.graph_without_negatives(name, index)
            descriptors = graph[f"{role}_descriptor"]
            weight = reward(error_changes(member, graph, objective.change), member.beta[int(graph.span_index)])
            weight = weight.clamp_min(0.0)
            distances = _distances_moved(graph, role)
            for node in equivalent_nodes:
                pairs = graph.instance_index[[0, node]]
                first, second = distances[pairs]
                resolution = RESOLUTION_PX if member.kernel.in_space else member.kernel.resolution
                difference = error_change(second, first, "relative", resolution)
                moment, product = _normal_equations(descriptors, pairs, weight, difference)
                moments, products = moments + moment, products + product
                total += float(weight.sum())
        if total > 0:
            # Two descriptors, both with noise of this norm spread over their components.
            ridge = 2 * total * noise**2 / width
            member.set_node_order(torch.linalg.solve(moments + ridge * torch.eye(width), products))


def _distances_moved(graph: MotifGraph, role: NodeType) -> Tensor:
    """Return how far each feature of a type moves in the transition, ``[n]`` in pixels; lines by their midpoints."""
    displacement = graph[f"{role}_next_geometry"] - graph[f"{role}_geometry"]
    distances: Tensor = displacement.reshape(len(displacement), role.geometry_dim // 2, 2).mean(dim=1).norm(dim=1)
    return distances


def _normal_equations(descriptors: Tensor, pairs: Tensor, weight: Tensor, difference: Tensor) -> tuple[Tensor, Tensor]:
    """Return the sums of w (f_i - f_j)(f_i - f_j)ᵀ and of w y (f_i - f_j) over the pairs.

    Computed by the Laplacian of the graph of pairs, without a row per pair.
    """
    count = len(descriptors)
    adjacency = torch.zeros(count, count).index_put_((pairs[0], pairs[1]), weight, accumulate=True)
    adjacency = adjacency + adjacency.T
    laplacian = torch.diag(adjacency.sum(dim=1)) - adjacency
    balance = torch.zeros(count).index_add_(0, pairs[0], weight * difference)
    balance = balance.index_add_(0, pairs[1], -weight * difference)
    return descriptors.T @ laplacian @ descriptors, descriptors.T @ balance
