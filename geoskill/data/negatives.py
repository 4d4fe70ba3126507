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

from geoskill.data.dead_leaves import dead_leaves
from geoskill.features.feature_set import FeatureSet
from geoskill.features.pipeline import FeaturePipeline
from geoskill.io.prefetch import Progress, parallel_map
from geoskill.tracking.motion import Displacement, Trajectory

# Frames of the demonstration, spread over it, from which negatives are taken.
SOURCES = 16
# Pictures of dead leaves beside each of them.
LEAVES = 3

Picture = UInt8[np.ndarray, "height width 3"]
CHANGES: tuple[Callable[[Picture], Picture], ...] = (
    lambda picture: picture[:, ::-1],
    lambda picture: 255 - picture,
    lambda picture: 255 - picture[:, ::-1],
)


def synthesize_negatives(
    frames: Sequence[Picture], pipeline: FeaturePipeline, progress: Progress, threads: int = 1
) -> FeatureSet:
    """The negatives of one extractor, the same for the same frames.

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

    of_frames = parallel_map(
        extract, pictures(), chosen, threads=threads, progress=progress, description="finding negatives"
    )
    found = [features for of_frame in of_frames for features in of_frame]
    descriptors = np.concatenate([each.descriptors for each in found])
    geometry = np.concatenate([each.geometry for each in found])
    return FeatureSet(found[0].node_type, descriptors, geometry, np.zeros(len(geometry), np.float32))


def append_negatives(
    features: FeatureSet, displacement: Displacement, trajectory: Trajectory, negatives: FeatureSet
) -> tuple[FeatureSet, Displacement, Trajectory]:
    """A frame's features and negatives after them, which are not followed and do not arrive."""
    count = len(negatives)
    weakest = features.scores[-1] if len(features) else 0.0
    joined = FeatureSet(
        features.node_type,
        np.concatenate([features.descriptors, negatives.descriptors]),
        np.concatenate([features.geometry, negatives.geometry]),
        np.concatenate([features.scores, np.full(count, weakest, np.float32)]),
    )
    own = torch.from_numpy(negatives.geometry)
    anchors = trajectory.anchor_xy.shape[1]
    return (
        joined,
        Displacement(torch.cat([displacement.next_geometry, own]), _false_after(displacement.tracked, count)),
        Trajectory(
            torch.cat([trajectory.anchor_xy, own[:, None].expand(-1, anchors, -1)]),
            torch.cat([trajectory.first_known_anchor, trajectory.first_known_anchor.new_full((count,), anchors)]),
            torch.cat([trajectory.final_xy, own]),
            _false_after(trajectory.final_known, count),
        ),
    )


def _false_after(values: Bool[Tensor, " n"], count: int) -> Bool[Tensor, " m"]:
    return torch.cat([values, values.new_zeros(count)])
