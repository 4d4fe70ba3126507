"""Propagation of detection noise through a function of image primitives, by its Jacobian."""

from collections.abc import Callable, Sequence
from typing import Final

import torch
from jaxtyping import Float
from torch import Tensor

DETECTION_STD_PX: Final = 0.5
"""Standard deviation of each coordinate of a detected feature, in pixels: three in four features are found again within
0.2 px, the others farther off (docs/experiments/switches.md)."""


def propagated_std(
    function: Callable[[Sequence[Float[Tensor, "m _"]]], Float[Tensor, "m d"]],
    primitives: Sequence[Float[Tensor, "m _"]],
    covariances: Sequence[Float[Tensor, "m _ _"]] | None = None,
) -> Float[Tensor, "m d"]:
    """Return the standard deviation of a function's values when every primitive has independent noise.

    To first order: the root of gᵀ C g summed over the primitives, with g the gradient of a value with respect to the
    coordinates of one of them.

    Args:
        function: takes the primitives of ``m`` instances; its values for one instance do not depend on another.
        primitives: points or segments in pixels, or primitives in space.
        covariances: of the coordinates of each primitive; None for :data:`DETECTION_STD_PX` in each, independently.

    The difference of two points:

    >>> propagated_std(lambda nodes: nodes[0] - nodes[1], [torch.zeros(1, 2), torch.ones(1, 2)]).round(decimals=4)
    tensor([[0.7071, 0.7071]])
    """
    with torch.inference_mode(False), torch.enable_grad():
        variables = [rows.detach().clone().requires_grad_() for rows in primitives]
        values = function(variables)
        if not values.requires_grad:  # constant, or without instances
            return torch.zeros_like(values)
        variances = []
        for row in range(values.shape[1]):
            gradients = torch.autograd.grad(values[:, row].sum(), variables, retain_graph=True, allow_unused=True)
            variances.append(
                sum(
                    DETECTION_STD_PX**2 * own.square().sum(dim=1)
                    if covariances is None
                    else torch.einsum("mi,mij,mj->m", own, covariances[node], own)
                    for node, own in enumerate(gradients)
                    if own is not None
                )
            )
    return torch.stack([torch.as_tensor(own) for own in variances], dim=1).clamp_min(0).sqrt()
