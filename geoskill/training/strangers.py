"""Features that never were there: what a skill must not be sure of, since it has never seen it take part.

A demonstration shows few things. What a robot's gripper or another table looks like is not among them, and a scorer is
free to like it. Features of the demonstration's own pictures in a mirror, as negatives, and both, are as natural as
real ones, but are no features of the scene: added to the frames in training, associations with them earn nothing.
"""

from collections.abc import Callable, Sequence

import numpy as np
import torch
from jaxtyping import Bool, UInt8
from torch import Tensor

from geoskill.features.feature_set import FeatureSet
from geoskill.features.pipeline import FeaturePipeline
from geoskill.graphs.motif_graph import Journey, Motion
from geoskill.training.tracks import Progress

# Frames of the demonstration, spread over it, from which strangers are taken.
SOURCES = 16

Picture = UInt8[np.ndarray, "height width 3"]
CHANGES: tuple[Callable[[Picture], Picture], ...] = (
    lambda picture: picture[:, ::-1],
    lambda picture: 255 - picture,
    lambda picture: 255 - picture[:, ::-1],
)


def find_strangers(
    frames: Sequence[Picture],
    features: Sequence[FeatureSet],
    pipeline: FeaturePipeline,
    likeness: float,
    progress: Progress,
) -> FeatureSet:
    """The strangers of one extractor.

    Args:
        frames: of the demonstration.
        features: theirs.
        pipeline: the extractor.
        likeness: a stranger that differs from some real feature by no more, as a symmetric pattern's does, is none.
        progress: shows progress over the frames.
    """
    real = np.concatenate([found.descriptors for found in features])
    chosen = np.unique(np.linspace(0, len(frames) - 1, SOURCES).round().astype(int)).tolist()
    sets = [
        pipeline.extract(np.ascontiguousarray(change(frames[t])))
        for t in progress(chosen, "finding strangers")
        for change in CHANGES
    ]
    descriptors = np.concatenate([found.descriptors for found in sets])
    geometry = np.concatenate([found.geometry for found in sets])
    # Of unit vectors, those closer than d have a product above 1 - d²/2.
    unlike = np.array(
        [(real @ descriptor).max(initial=-1.0) < 1.0 - likeness**2 / 2 for descriptor in descriptors], bool
    )
    return FeatureSet(features[0].node_type, descriptors[unlike], geometry[unlike], np.zeros(unlike.sum(), np.float32))


def with_strangers(
    features: FeatureSet, motion: Motion, journey: Journey, strangers: FeatureSet
) -> tuple[FeatureSet, Motion, Journey]:
    """A frame's features and strangers after them, which are not followed and do not arrive."""
    count = len(strangers)
    weakest = features.strength.min(initial=np.inf) if len(features) else 0.0
    joined = FeatureSet(
        features.node_type,
        np.concatenate([features.descriptors, strangers.descriptors]),
        np.concatenate([features.geometry, strangers.geometry]),
        np.concatenate([features.strength, np.full(count, weakest, np.float32)]),
    )
    own = torch.from_numpy(strangers.geometry)
    anchors = journey.places.shape[1]
    return (
        joined,
        Motion(torch.cat([motion.geometry, own]), _false_after(motion.followed, count)),
        Journey(
            torch.cat([journey.places, own[:, None].expand(-1, anchors, -1)]),
            torch.cat([journey.since, journey.since.new_full((count,), anchors)]),
            torch.cat([journey.final, own]),
            _false_after(journey.arrives, count),
        ),
    )


def _false_after(values: Bool[Tensor, " n"], count: int) -> Bool[Tensor, " m"]:
    return torch.cat([values, values.new_zeros(count)])
