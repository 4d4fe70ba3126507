"""Where tracked features are in space: lifted with the depth of the frames that the flow leads to.

Each frame's depth is looked at once, one frame after the other, so that a long recording's need not be kept. A feature
that stays at its very pixel, such as one that is known to rest, stays where it is in space: at the other time, a hand
may pass before it.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import final

import numpy as np
import torch
from jaxtyping import Float32, Int64

from geoskill.features.feature_set import FeatureSet
from geoskill.features.lifting import lift
from geoskill.geometry.depth_picture import DepthPicture
from geoskill.geometry.primitives import NodeType
from geoskill.tracking.motion import Displacement, Trajectory


def lift_motions(
    features: Sequence[FeatureSet],
    displacements: Mapping[tuple[int, int], Displacement],
    trajectories: Sequence[Trajectory],
    anchor_frames: Int64[np.ndarray, "frames a"],
    final_frames: Int64[np.ndarray, " frames"],
    depths: Iterable[DepthPicture],
) -> tuple[dict[tuple[int, int], Displacement], list[Trajectory]]:
    """Return displacements and trajectories with their places in space; NaN where there is no depth.

    Args:
        features: of every frame, all of one type, lifted.
        displacements: of the features of frame ``t`` to ``t + span``, by ``(t, span)``.
        trajectories: of every frame's features.
        anchor_frames: the frame in which each anchor of each frame's trajectories is read; -1 where it is not.
        final_frames: the frame in which each frame's features end.
        depths: of every frame, in order.
    """
    jobs: dict[int, list[_Job]] = {}
    next_space = {}
    for (frame, span), displacement in displacements.items():
        job = _Job(features[frame], displacement.next_geometry.numpy(), displacement.tracked.numpy())
        next_space[frame, span] = job.space
        jobs.setdefault(frame + span, []).append(job)
    anchor_space, final_space = [], []
    for frame, trajectory in enumerate(trajectories):
        anchors = trajectory.anchor_xy.shape[1]
        own = np.repeat(_space(features[frame])[:, None], anchors, axis=1)
        for anchor in range(anchors):
            known = trajectory.first_known_anchor.numpy() <= anchor
            if anchor_frames[frame, anchor] >= 0:
                job = _Job(features[frame], trajectory.anchor_xy[:, anchor].numpy(), known, own[:, anchor])
                jobs.setdefault(int(anchor_frames[frame, anchor]), []).append(job)
        anchor_space.append(own)
        job = _Job(features[frame], trajectory.final_xy.numpy(), trajectory.final_known.numpy())
        final_space.append(job.space)
        jobs.setdefault(int(final_frames[frame]), []).append(job)
    for frame, depth in enumerate(depths):
        _lift_all(features[frame].node_type, jobs.pop(frame, []), depth)
    return (
        {
            key: replace(displacement, next_space=torch.from_numpy(next_space[key]))
            for key, displacement in displacements.items()
        },
        [
            replace(own, anchor_space=torch.from_numpy(anchors), final_space=torch.from_numpy(final))
            for own, anchors, final in zip(trajectories, anchor_space, final_space, strict=True)
        ],
    )


def flow_frames(
    count: int, hop: int, anchors: int
) -> tuple[Int64[np.ndarray, "frames a"], Int64[np.ndarray, " frames"]]:
    """Return in which frames trajectories by flow (:mod:`geoskill.tracking.trajectories`) are read, and end.

    >>> anchor_frames, final_frames = flow_frames(count=6, hop=2, anchors=2)
    >>> anchor_frames[:, 0].tolist(), anchor_frames[:, 1].tolist(), final_frames.tolist()
    ([0, 1, 0, 1, 0, 1], [-1, -1, -1, -1, -1, 5], [4, 5, 4, 5, 4, 5])
    """
    frames = np.arange(count)[:, None]
    at = np.linspace(0, count - 1, anchors).round().astype(np.int64)
    anchor_frames = np.where(at <= frames, frames - (frames - at) // hop * hop, -1)
    return anchor_frames, frames[:, 0] + (count - 1 - frames[:, 0]) // hop * hop


def end_frames(count: int, anchors: int) -> tuple[Int64[np.ndarray, "frames a"], Int64[np.ndarray, " frames"]]:
    """Return the same for trajectories by known ends (:mod:`geoskill.tracking.known_ends`): the first and the last."""
    return np.zeros((count, anchors), np.int64), np.full(count, count - 1)


@final
class _Job:
    """The features of one frame at their pixels of another one.

    Args:
        features: lifted.
        geometry: ``[n, g]`` in the other frame.
        known: ``[n]``, whether that is known; all others stay where they are.
        space: where the result is written to; None for an array of its own.
    """

    def __init__(
        self, features: FeatureSet, geometry: np.ndarray, known: np.ndarray, space: np.ndarray | None = None
    ) -> None:
        self.space = _space(features).copy() if space is None else space
        self.rows = np.flatnonzero(known & (geometry != features.geometry).any(axis=1))
        self.geometry = geometry[self.rows]


def _lift_all(node_type: NodeType, jobs: Sequence[_Job], depth: DepthPicture) -> None:
    if not jobs:
        return
    geometry = np.concatenate([job.geometry for job in jobs]).astype(np.float32)
    # Many frames' features are the same ones, tracked to the same places.
    places, inverse = np.unique(geometry, axis=0, return_inverse=True)
    lifted = lift(node_type, places, depth)[0][inverse.reshape(-1)]
    start = 0
    for job in jobs:
        job.space[job.rows] = lifted[start : start + len(job.rows)]
        start += len(job.rows)


def _space(features: FeatureSet) -> Float32[np.ndarray, "n s"]:
    if features.space is None:
        raise ValueError("features without space; expected lifted ones")
    return features.space
