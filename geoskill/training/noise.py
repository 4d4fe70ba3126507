"""Noise on descriptors: a single video shows each feature under one light and from one side only."""

import math

import torch
from jaxtyping import Float
from torch import Tensor


def noisy(descriptors: Float[Tensor, "n d"], strength: float, generator: torch.Generator) -> Float[Tensor, "n d"]:
    """Unit-norm descriptors with Gaussian noise whose expected squared norm is ``strength`` squared.

    The SD of one component is ``strength / sqrt(d)``, so one value means the same for descriptors of any length.
    """
    noise = torch.randn(descriptors.shape, generator=generator, device=descriptors.device, dtype=descriptors.dtype)
    return descriptors + noise * (strength / math.sqrt(descriptors.shape[1]))
