"""Extracted features on disk, found again by the frame's content and the pipeline's identity."""

import hashlib
from collections.abc import Callable, Mapping
from typing import final

import numpy as np
from jaxtyping import UInt8

from geoskill.features.feature_set import FeatureSet
from geoskill.geometry.primitives import NodeType
from geoskill.io.disk_cache import DiskCache

# Raise it when the meaning of what an extractor returns changes without its settings changing.
FORMAT = 2


@final
class FeatureCache:
    """The features of one frame by one pipeline are one entry of a store.

    Args:
        store: where they are kept.
    """

    def __init__(self, store: DiskCache) -> None:
        self._store = store

    def get_or_compute(
        self, frame: UInt8[np.ndarray, "height width 3"], identity: str, compute: Callable[[], FeatureSet]
    ) -> FeatureSet:
        """The stored features of this frame under this identity, or those of ``compute``, which are then stored."""
        digest = hashlib.sha256(f"{FORMAT} {identity} {frame.shape}".encode())
        digest.update(np.ascontiguousarray(frame).data)
        return self._store.get_or_compute(digest.hexdigest(), compute, _pack, _unpack)


def _pack(features: FeatureSet) -> Mapping[str, np.ndarray]:
    return {
        "node_type": np.array(str(features.node_type)),
        "descriptors": features.descriptors,
        "geometry": features.geometry,
        "strength": features.strength,
    }


def _unpack(stored: Mapping[str, np.ndarray]) -> FeatureSet:
    return FeatureSet(NodeType(str(stored["node_type"])), stored["descriptors"], stored["geometry"], stored["strength"])
