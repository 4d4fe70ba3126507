"""Features that never were there: what a skill must not be sure of, since it has never seen it take part.

A demonstration shows few things. What a robot's gripper or another table looks like is not among them, and a scorer is
free to like it. Added to the frames in training are features of the demonstration's own pictures in a mirror, as
negatives, and both, and of pictures of dead leaves; associations with them earn nothing. Some look like a real feature:
the corner of any bright rectangle looks like its mirror image. To prefer what is not found everywhere is their use.
"""

from collections.abc import Callable, Iterator, Sequence

import numpy as np
import torch
from jaxtyping import Bool, UInt8
from torch import Tensor

from geoskill.features.ahead import Progress, map_all
from geoskill.features.feature_set import FeatureSet
from geoskill.features.pipeline import FeaturePipeline
from geoskill.graphs.motif_graph import Journey, Motion
from geoskill.training.dead_leaves import dead_leaves

# Frames of the demonstration, spread over it, from which strangers are taken.
SOURCES = 16
# Pictures of dead leaves beside each of them.
LEAVES = 3

Picture = UInt8[np.ndarray, "height width 3"]
CHANGES: tuple[Callable[[Picture], Picture], ...] = (
    lambda picture: picture[:, ::-1],
    lambda picture: 255 - picture,
    lambda picture: 255 - picture[:, ::-1],
)


def find_strangers(
    frames: Sequence[Picture], pipeline: FeaturePipeline, progress: Progress, threads: int = 1
) -> FeatureSet:
    """The strangers of one extractor, the same for the same frames.

    Args:
        frames: of the demonstration.
        pipeline: the extractor.
        progress: shows progress over the frames that are taken.
        threads: of how many of these the pictures are worked on at once.
    """
    random = np.random.default_rng(0)
    height, width = frames[0].shape[:2]
    chosen = np.unique(np.linspace(0, len(frames) - 1, SOURCES).round().astype(int)).tolist()

    def pictures() -> Iterator[list[Picture]]:  # taken in one order, whatever the threads, and so drawn in one order
        for t in chosen:
            changed = [np.ascontiguousarray(change(frames[t])) for change in CHANGES]
            yield changed + [dead_leaves(height, width, random) for _ in range(LEAVES)]

    def extract(pictures: list[Picture]) -> list[FeatureSet]:
        return [pipeline.extract(picture) for picture in pictures]

    of_frames = map_all(
        extract, pictures(), chosen, threads=threads, progress=progress, description="finding strangers"
    )
    found = [features for of_frame in of_frames for features in of_frame]
    descriptors = np.concatenate([each.descriptors for each in found])
    geometry = np.concatenate([each.geometry for each in found])
    return FeatureSet(found[0].node_type, descriptors, geometry, np.zeros(len(geometry), np.float32))


def with_strangers(
    features: FeatureSet, motion: Motion, journey: Journey, strangers: FeatureSet
) -> tuple[FeatureSet, Motion, Journey]:
    """A frame's features and strangers after them, which are not followed and do not arrive."""
    count = len(strangers)
    weakest = features.strength[-1] if len(features) else 0.0
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
