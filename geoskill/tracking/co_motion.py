"""Detection of co-motion: features that have recently moved together belong to one object.

An object in a hand or a gripper moves with it. Of two nodes with the same displacement against the background, neither
is the target of the other, however similar their descriptors are to the right ones. Nothing is concluded about features
that rest (the object rests before it is grasped), move slowly, or have paused for longer than the window. Psychology
knows the principle as the law of common fate (Wertheimer, 1923).
"""

from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import final

import cv2
import numpy as np
from jaxtyping import Bool, Float, Float32, Int, UInt8

from geoskill.geometry.primitives import NodeType, centers
from geoskill.geometry.sampling import resized
from geoskill.kernels.kernel import Kernel
from geoskill.tracking.flow import Flow, gray_flow, track_dense
from geoskill.tuning import CoMotionConfig

# Columns and rows of the grid points to which the background's motion is fitted.
GRID = (20, 15)


@final
@dataclass(frozen=True, eq=False)
class _Step:
    """The motion from a frame to the one before it.

    Attributes:
        flow: dense flow, of everything.
        background: maps homogeneous pixels of the background from the frame before to this one; None if unclear.
    """

    flow: Flow
    background: Float[np.ndarray, "3 3"] | None


@final
class CoMotionDetector:
    """Recent motion in a video: the flows from each frame of a window to the one before it.

    Args:
        config: window and thresholds; None for the defaults.
    """

    def __init__(self, config: CoMotionConfig | None = None) -> None:
        self._config = CoMotionConfig() if config is None else config
        self._shape = (0, 0)
        self._small: UInt8[np.ndarray, "_ _"] | None = None
        self._steps: deque[_Step] = deque(maxlen=self._config.window_frames)

    def advance(self, gray: UInt8[np.ndarray, "height width"]) -> None:
        """Add the next frame; a frame of another size restarts the window."""
        height, width = gray.shape
        side = self._config.working_side
        # A long, thin picture is not enlarged beyond the size of other pictures.
        scale = min(side / min(height, width), max(1.0, 2 * side / max(height, width)))
        small = resized(gray, scale)
        if (height, width) != self._shape:
            self._steps.clear()
        elif self._small is not None:
            # The check by a backward flow would take as long again for the same selections (docs/experiments/speed.md).
            preset = cv2.DISOPTICAL_FLOW_PRESET_FAST
            flow = replace(gray_flow(small, self._small, preset, with_backward=False), scale=scale)
            self._steps.append(_Step(flow, _background_motion(flow, gray.shape, self._config.min_background_ratio)))
        self._shape, self._small = (height, width), small

    def co_moving(
        self,
        kernel: Kernel,
        geometry: Mapping[NodeType, Float32[np.ndarray, "n _"]],
        instances: Int[np.ndarray, "k m"],
    ) -> Bool[np.ndarray, " m"]:
        """Return which instances of a kernel have co-moving nodes.

        The nodes' displacements are compared over the longest past in which all of them can be tracked.

        Args:
            kernel: gives the types of the nodes.
            geometry: of the present frame's features, in pixels.
            instances: the features of each instance, one row for each node.

        Raises:
            ValueError: before the first frame.
        """
        if self._small is None:
            raise ValueError("no frame has been shown; expected advance() first")
        displacements = {node_type: self._displacements(node_type, rows) for node_type, rows in geometry.items()}
        tracked_frames = {
            node_type: (~np.isnan(by_age[:, :, 0])).sum(axis=0) - 1 for node_type, by_age in displacements.items()
        }
        min_px = self._config.min_displacement_ratio * min(self._shape)
        # Most features rest, and need not be compared with all others: of two co-moving nodes, the shorter displacement
        # is nearly as long as the longer one.
        shorter_px = (1 - self._config.max_difference_ratio) * min_px
        moving = {
            node_type: (np.linalg.norm(by_age, axis=2) > shorter_px).any(axis=0)
            for node_type, by_age in displacements.items()
        }
        nodes = list(zip(kernel.roles, instances, strict=True))
        (compared,) = np.all([moving[node_type][features] for node_type, features in nodes], axis=0).nonzero()
        age = np.min([tracked_frames[node_type][features[compared]] for node_type, features in nodes], axis=0)
        by_node = np.stack([displacements[node_type][age, features[compared]] for node_type, features in nodes])
        longest = np.linalg.norm(by_node, axis=2).max(axis=0)
        difference = np.linalg.norm(by_node[:, None] - by_node[None], axis=3).max(axis=(0, 1))
        co_moving = np.zeros(instances.shape[1], bool)
        co_moving[compared] = (longest > min_px) & (difference <= self._config.max_difference_ratio * longest)
        return co_moving

    def _displacements(self, node_type: NodeType, geometry: Float32[np.ndarray, "n _"]) -> Float32[np.ndarray, "w n 2"]:
        """Return the displacements of features (lines: of midpoints) against the background since 0, 1, ... frames ago.

        In pixels, relative to where the features would be had they rested; NaN for frames to which a feature cannot be
        tracked back.
        """
        past, kept, to_present = [geometry], [np.ones(len(geometry), bool)], [np.eye(3)]
        for step in reversed(self._steps):
            if step.background is None:
                break
            moved, tracked = track_dense(node_type, past[-1], step.flow)
            past.append(moved)
            kept.append(kept[-1] & tracked)
            to_present.append(to_present[-1] @ step.background)
        past_centers = centers(np.concatenate(past)).reshape(len(past), len(geometry), 2)
        motion = np.stack(to_present)
        if_at_rest = past_centers @ motion[:, :2, :2].transpose(0, 2, 1) + motion[:, None, :2, 2]
        displacements: np.ndarray = (past_centers[0] - if_at_rest).astype(np.float32)
        displacements[~np.stack(kept)] = np.nan
        return displacements


def _background_motion(flow: Flow, shape: tuple[int, int], min_ratio: float) -> Float[np.ndarray, "3 3"] | None:
    """Return the background of a :class:`_Step`: rotation, scale and shift of at least this ratio of the picture."""
    height, width = shape
    columns, rows = np.meshgrid((np.arange(GRID[0]) + 0.5) / GRID[0], (np.arange(GRID[1]) + 0.5) / GRID[1])
    present = np.stack([columns.ravel() * width, rows.ravel() * height], axis=1).astype(np.float32) - np.float32(0.5)
    before, tracked = track_dense(NodeType.POINT, present, flow)
    if tracked.sum() < 2:
        return None
    motion, resting = cv2.estimateAffinePartial2D(
        before[tracked], present[tracked], method=cv2.RANSAC, ransacReprojThreshold=1.0 / flow.scale
    )
    if motion is None or resting.mean() < min_ratio:
        return None
    return np.concatenate([motion, [[0.0, 0.0, 1.0]]])
