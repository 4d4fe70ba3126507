"""Extracted features on disk, found by the content of the frame and the identity of the pipeline."""

import hashlib
from collections.abc import Callable, Mapping
from typing import final

import numpy as np
from jaxtyping import UInt8

from geoskill.features.feature_set import FeatureSet
from geoskill.geometry.depth_picture import DepthPicture
from geoskill.geometry.primitives import NodeType
from geoskill.io.disk_cache import DiskCache

# Raise it when the file format, or what an extractor returns for the same settings, changes.
FORMAT = 5


@final
class FeatureCache:
    """A cache of feature sets; the features of one frame by one pipeline are one entry.

    Args:
        store: keeps the entries.
    """

    def __init__(self, store: DiskCache) -> None:
        self._store = store

    def get_or_compute(
        self,
        frame: UInt8[np.ndarray, "height width 3"],
        identity: str,
        compute: Callable[[], FeatureSet],
        depth: DepthPicture | None = None,
    ) -> FeatureSet:
        """Return the features stored for a frame and an identity; if there are none, compute and store them.

        Args:
            frame: the picture.
            identity: everything besides the frame that the features depend on.
            compute: finds them.
            depth: of the picture, where the features depend on it.
        """
        camera = "" if depth is None else f" {depth.depth_m.dtype} {depth.camera}"
        digest = hashlib.sha256(f"{FORMAT} {identity} {frame.shape}{camera}".encode())
        digest.update(np.ascontiguousarray(frame).data)
        if depth is not None:
            digest.update(np.ascontiguousarray(depth.depth_m).data)
        return self._store.get_or_compute(digest.hexdigest(), compute, _pack, _unpack)


def _pack(features: FeatureSet) -> Mapping[str, np.ndarray]:
    arrays = {
        "node_type": np.array(str(features.node_type)),
        "descriptors": features.descriptors,
        "geometry": features.geometry,
        "scores": features.scores,
    }
    if features.space is not None and features.space_covariance is not None:
        arrays |= {"space": features.space, "space_covariance": features.space_covariance}
    return arrays


def _unpack(stored: Mapping[str, np.ndarray]) -> FeatureSet:
    return FeatureSet(
        NodeType(str(stored["node_type"])),
        stored["descriptors"],
        stored["geometry"],
        stored["scores"],
        space=stored.get("space"),
        space_covariance=stored.get("space_covariance"),
    )
