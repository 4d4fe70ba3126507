"""Control errors of nodes that are not, or not all, detected in a frame: tracked ones, in the picture or in space."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import torch

from geoskill.features.lifting import lift
from geoskill.geometry.depth_picture import DepthPicture
from geoskill.geometry.uncertainty import propagated_std
from geoskill.kernels.kernel import Kernel
from geoskill.skill.association import Node

Values = tuple[float, ...]


def error_of_nodes(kernel: Kernel, nodes: Sequence[Node]) -> tuple[Values, Values]:
    """Return the control error of one association and the standard deviation of its rows.

    Args:
        kernel: gives the error.
        nodes: by role, directed; with their places in space for a kernel in space.
    """
    if not kernel.in_space:
        geometry = [torch.tensor([node.coordinates]) for node in nodes]
        error, std = kernel.control_error(geometry), propagated_std(kernel.control_error, geometry)
    else:
        places = [torch.tensor([node.space]) for node in nodes]
        covariances = [torch.tensor([node.space_covariance]) for node in nodes]
        error, std = kernel.control_error(places), propagated_std(kernel.control_error, places, covariances)
    return tuple(error[0].tolist()), tuple(std[0].tolist())


def lifted_nodes(nodes: Sequence[Node], depth: DepthPicture | None) -> tuple[Node, ...] | None:
    """Return tracked nodes with their places in space, or None where the depth of one is not known.

    Args:
        nodes: where flow leads them.
        depth: of the frame.
    """
    if depth is None:
        return None
    lifted = []
    for node in nodes:
        space, covariance = lift(node.node_type, np.array([node.coordinates], np.float32), depth)
        if not np.isfinite(space).all():
            return None
        lifted.append(
            replace(node, space=tuple(space[0].tolist()), space_covariance=tuple(map(tuple, covariance[0].tolist())))
        )
    return tuple(lifted)
