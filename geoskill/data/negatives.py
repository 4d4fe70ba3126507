"""Synthetic negative features, added to each training frame so that the scorer rejects unseen objects.

A demonstration shows few objects. What a robot's gripper or another table looks like is not among them, and the scorer
is free to give it a high score. The negatives are features of the demonstration's own pictures mirrored, inverted, and
both, and of pictures of dead leaves; associations with them earn nothing. Some look like a real feature: the corner of
any bright rectangle looks like its mirror image. They make the scorer prefer features that are not found everywhere.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace

import numpy as np
import torch
from jaxtyping import Bool, UInt8
from torch import Tensor

from geoskill.data.dead_leaves import dead_leaves
from geoskill.features.feature_set import FeatureSet, joined_features
from geoskill.features.pipeline import FeaturePipeline
from geoskill.geometry.depth_picture import DepthPicture
from geoskill.io.prefetch import Progress, parallel_map
from geoskill.tracking.motion import Displacement, Part, Trajectory
from geoskill.tuning import NegativesConfig

Picture = UInt8[np.ndarray, "height width 3"]
Negative = tuple[Picture, DepthPicture | None]
TRANSFORMS: tuple[Callable[[Picture, DepthPicture | None], Negative], ...] = (
    lambda picture, depth: (picture[:, ::-1], depth and depth.mirrored()),
    lambda picture, depth: (255 - picture, depth),
    lambda picture, depth: (255 - picture[:, ::-1], depth and depth.mirrored()),
)


def synthesize_negatives(
    frames: Sequence[Picture],
    pipeline: FeaturePipeline,
    progress: Progress,
    threads: int = 1,
    config: NegativesConfig | None = None,
    depths: Sequence[DepthPicture] | None = None,
) -> FeatureSet:
    """Extract the negatives of one extractor, the same whenever the frames are the same.

    Dead leaves have the depth of the frame in whose place they are.

    Args:
        frames: of the demonstration.
        pipeline: the extractor.
        progress: shows progress over the source frames.
        threads: number of source frames that are worked on at once.
        config: numbers of pictures; None for the defaults.
        depths: of the frames, if they have any.
    """
    config = NegativesConfig() if config is None else config
    leaves_per_frame = config.leaves_per_frame
    random = np.random.default_rng(0)
    height, width = frames[0].shape[:2]
    chosen = np.unique(np.linspace(0, len(frames) - 1, config.source_frames).round().astype(int)).tolist()

    def pictures() -> Iterator[list[Negative]]:  # consumed in order, so that threads do not change the random draws
        for t in chosen:
            depth = None if depths is None else depths[t]
            transformed = [transform(frames[t], depth) for transform in TRANSFORMS]
            yield transformed + [(dead_leaves(height, width, random), depth) for _ in range(leaves_per_frame)]

    def extract(pictures: list[Negative]) -> list[FeatureSet]:
        return [pipeline.extract(np.ascontiguousarray(picture), depth) for picture, depth in pictures]

    by_frame = parallel_map(
        extract, pictures(), chosen, threads=threads, progress=progress, description="finding negatives"
    )
    feature_sets = [features for frame_features in by_frame for features in frame_features]
    return joined_features([replace(own, scores=np.zeros(len(own), np.float32)) for own in feature_sets])


def append_negatives(
    features: FeatureSet, displacement: Displacement, trajectory: Trajectory, negatives: FeatureSet
) -> tuple[FeatureSet, Displacement, Trajectory]:
    """Return a frame's features with negatives after them, which are neither tracked nor known at any other time.

    Where it is known what the features belong to, it is known that the negatives have no part in the task. They would
    otherwise count as what may approach, and outnumber the few features of a plain thing (docs/experiments/places.md).
    """
    count = len(negatives)
    part = Part.UNRELATED if bool((trajectory.part != Part.UNKNOWN).any()) else Part.UNKNOWN
    weakest = features.scores[-1] if len(features) else 0.0
    joined = joined_features([features, replace(negatives, scores=np.full(count, weakest, np.float32))])
    geometry = torch.from_numpy(negatives.geometry)
    space = None if negatives.space is None else torch.from_numpy(negatives.space)
    anchors = trajectory.anchor_xy.shape[1]
    return (
        joined,
        Displacement(
            torch.cat([displacement.next_geometry, geometry]),
            _append_false(displacement.tracked, count),
            _append(displacement.next_space, space),
        ),
        Trajectory(
            torch.cat([trajectory.anchor_xy, geometry[:, None].expand(-1, anchors, -1)]),
            torch.cat([trajectory.first_known_anchor, trajectory.first_known_anchor.new_full((count,), anchors)]),
            torch.cat([trajectory.final_xy, geometry]),
            _append_false(trajectory.final_known, count),
            torch.cat([trajectory.part, torch.full((count,), part)]),
            _append(trajectory.anchor_space, None if space is None else space[:, None].expand(-1, anchors, -1)),
            _append(trajectory.final_space, space),
        ),
    )


def _append(rows: Tensor | None, others: Tensor | None) -> Tensor | None:
    return None if rows is None or others is None else torch.cat([rows, others])


def _append_false(values: Bool[Tensor, " n"], count: int) -> Bool[Tensor, " m"]:
    return torch.cat([values, values.new_zeros(count)])
