"""DISK keypoints and descriptors (Tyszkiewicz et al., NeurIPS 2020), through kornia."""

from typing import Any, ClassVar, final

import numpy as np
import torch
from jaxtyping import UInt8

from geoskill.features.extractor import FeatureExtractor
from geoskill.features.feature_set import FeatureSet
from geoskill.features.learned_points import has_structure, network_input, point_features
from geoskill.features.learned_weights import kornia_feature, load_network, named_weights
from geoskill.geometry.primitives import NodeType

URLS = (
    "https://huggingface.co/kornia/disk/resolve/main/depth-save.pth",
    "https://raw.githubusercontent.com/cvlab-epfl/disk/master/depth-save.pth",
)


@final
class Disk(FeatureExtractor):
    """kornia's DISK, pretrained for matching; needs the extra ``learned``. Its accuracy here was not measured.

    Args:
        weights: path of a file of weights; null for the published ones, which are downloaded once. A skill keeps the
            file's digest.
    """

    name: ClassVar[str] = "disk"
    node_type: ClassVar[NodeType] = NodeType.POINT
    descriptor_dim: ClassVar[int] = 128

    def __init__(self, *, weights: str | None = None) -> None:
        self.weights = named_weights(self.name, weights)

    def extract(self, image: UInt8[np.ndarray, "height width"], limit: int | None = None) -> FeatureSet:
        """Return the keypoints of a picture, highest score first; see :meth:`FeatureExtractor.extract`."""
        if not has_structure(image):
            return FeatureSet.empty(self.node_type, self.descriptor_dim)
        network = load_network(self.name, self.weights, URLS, _network)
        with torch.inference_mode():
            found = network(network_input(image), pad_if_not_divisible=True)[0]
        return point_features(found.keypoints, found.detection_scores, found.descriptors, limit)


def _network() -> Any:
    return kornia_feature(Disk.name).DISK()
