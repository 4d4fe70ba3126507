"""From a gray picture to the input of a pretrained network, and from its keypoints to a feature set."""

import numpy as np
import torch
from jaxtyping import Float, UInt8
from torch import Tensor

from geoskill.features.feature_set import FeatureSet
from geoskill.geometry.primitives import NodeType

# Networks halve a picture five times.
MIN_SIDE = 32
# Gray levels below which a picture is plain; networks would find features in the noise of their own.
MIN_CONTRAST = 4


def has_structure(image: UInt8[np.ndarray, "height width"]) -> bool:
    """Return whether a picture is large and varied enough to have features."""
    return min(image.shape) >= MIN_SIDE and int(image.max()) - int(image.min()) >= MIN_CONTRAST


def network_input(image: UInt8[np.ndarray, "height width"]) -> Float[Tensor, "1 3 height width"]:
    """Return a gray picture as three equal channels from 0 to 1."""
    return torch.from_numpy(image.astype(np.float32) / 255).expand(1, 3, -1, -1)


def point_features(
    xy: Float[Tensor, "n 2"], scores: Float[Tensor, " n"], descriptors: Float[Tensor, "n d"], limit: int | None
) -> FeatureSet:
    """Return keypoints as a feature set, strongest first, with descriptors of unit norm.

    Args:
        xy: positions in pixels, x to the right and y down.
        scores: of the detector.
        descriptors: of any norm above 0.
        limit: how many are needed; None for all.
    """
    norms = descriptors.norm(dim=1)
    usable = torch.isfinite(scores) & (norms > 1e-6) & torch.isfinite(norms)
    order = torch.sort(torch.where(usable, scores, -torch.inf), descending=True, stable=True).indices
    chosen = order[: int(usable.sum())][:limit]
    units = (descriptors[chosen] / norms[chosen, None]).contiguous()
    return FeatureSet(
        NodeType.POINT,
        units.numpy().astype(np.float32),
        xy[chosen].numpy().astype(np.float32),
        scores[chosen].numpy().astype(np.float32),
    )
