"""ALIKED keypoints and descriptors (Zhao et al., IEEE TIM 2023), through kornia."""

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
    "https://huggingface.co/kornia/aliked/resolve/main/aliked-n16.pth",
    "https://github.com/Shiaoming/ALIKED/raw/main/models/aliked-n16.pth",
)


@final
class Aliked(FeatureExtractor):
    """kornia's ALIKED-n16, pretrained for matching; needs the extra ``learned``. Its accuracy here was not measured.

    Args:
        weights: path of a file of weights; null for the published ones, which are downloaded once. A skill keeps the
            file's digest.
    """

    name: ClassVar[str] = "aliked"
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
            found = network(network_input(image))[0]
        return point_features(found.keypoints, found.keypoint_scores, found.descriptors, limit)


def _network() -> Any:
    return kornia_feature(Aliked.name).ALIKED()
