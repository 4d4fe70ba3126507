"""Common fate: features that have lately moved as one belong to one thing, and nobody is bringing them together.

What a hand or a gripper carries moves with it, so of two nodes that went the same way against the background neither is
the other's target, however much their descriptors look like it. Nodes that rest say nothing: before it is grasped, the
object rests, too. (The law of common fate is Wertheimer's, 1923.)
"""

from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass
from typing import final

import cv2
import numpy as np
from jaxtyping import Bool, Float, Float32, Int, UInt8

from geoskill.features.flow import Flow, follow_along, grey_flow
from geoskill.geometry.primitives import NodeType
from geoskill.kernels.kernel import Kernel

# Settled on simulated sorting (occluded, moved camera, dark) and folding, seeds 3 to 6: of the ten best associations of
# every second frame, 151 of 842 wrong ones have moved as one, and none of 2938 right ones. With twice the window and
# twice the difference it is 191 and 73, most of these where the edge of a shadow moves over the target.
# How many frames back: less than half a second of video, in which a hand or an arm at work goes a visible way.
WINDOW = 12
# Of the picture's shorter side: below it a feature rests. Ten pixels of VGA, several times what flow is wrong by after
# a window of frames.
LEAST_WAY = 0.02
# Two nodes have moved as one when their ways differ by no more than this share of the longer one: turned by 9 degrees
# at most, or one of them nearer to the camera by a seventh.
LARGEST_DIFFERENCE = 0.15
# Shorter side in pixels at which frames are compared: half of VGA, at which flow takes 3 ms of a core.
WORKING_SIDE = 240
# Places, in columns and rows, most of which are taken to be of the background.
GRID = (20, 15)


@final
@dataclass(frozen=True, eq=False)
class _Step:
    """From a frame to the one before it.

    Attributes:
        flow: of everything.
        background: of what rests, the other way, in homogeneous pixels.
    """

    flow: Flow
    background: Float[np.ndarray, "3 3"]


@final
class RecentMotion:
    """How things in a video have moved of late, as the flow from each frame of a window to the one before it."""

    def __init__(self) -> None:
        self._present: UInt8[np.ndarray, "height width"] | None = None
        self._steps: deque[_Step] = deque(maxlen=WINDOW)

    def advance(self, grey: UInt8[np.ndarray, "height width"]) -> None:
        """Goes on to the next frame; one of another size begins anew."""
        if self._present is not None and self._present.shape != grey.shape:
            self._steps.clear()
        elif self._present is not None:
            flow = grey_flow(grey, self._present, working_side=WORKING_SIDE, preset=cv2.DISOPTICAL_FLOW_PRESET_FAST)
            self._steps.append(_Step(flow, _background(flow, grey.shape)))
        self._present = grey

    def moved_as_one(
        self,
        kernel: Kernel,
        geometry: Mapping[NodeType, Float32[np.ndarray, "n _"]],
        instances: Int[np.ndarray, "k m"],
    ) -> Bool[np.ndarray, " m"]:
        """Which instances of a kernel have nodes that all moved the same way, as far back as all can be followed.

        Args:
            kernel: gives the nodes' types.
            geometry: of the present frame's features, in its pixels; segments move as their midpoints do.
            instances: the features of each instance, one row for each node.
        """
        if self._present is None:
            raise ValueError("no frame has been shown; expected advance() first")
        ways = {kind: self._ways(_centres(kind, rows)) for kind, rows in geometry.items()}
        followed = {kind: (~np.isnan(way[:, :, 0])).sum(axis=0) - 1 for kind, way in ways.items()}
        least_px = LEAST_WAY * min(self._present.shape)
        # Of many features most rest, and those need not be compared with all others.
        shorter_px = (1 - LARGEST_DIFFERENCE) * least_px
        moving = {kind: (np.linalg.norm(way, axis=2) > shorter_px).any(axis=0) for kind, way in ways.items()}
        nodes = list(zip(kernel.roles, instances, strict=True))
        (compared,) = np.all([moving[kind][features] for kind, features in nodes], axis=0).nonzero()
        since = np.min([followed[kind][features[compared]] for kind, features in nodes], axis=0)
        of_nodes = np.stack([ways[kind][since, features[compared]] for kind, features in nodes])
        longest = np.linalg.norm(of_nodes, axis=2).max(axis=0)
        difference = np.linalg.norm(of_nodes[:, None] - of_nodes[None], axis=3).max(axis=(0, 1))
        as_one = np.zeros(instances.shape[1], bool)
        as_one[compared] = (longest > least_px) & (difference <= LARGEST_DIFFERENCE * longest)
        return as_one

    def _ways(self, points: Float32[np.ndarray, "n 2"]) -> Float32[np.ndarray, "w n 2"]:
        """How far points came, against the background, since 0, 1, ... frames before; NaN where they were not seen."""
        places, lost = points, np.zeros(len(points), bool)
        to_present = np.eye(3)
        ways = [np.zeros_like(points)]
        for step in reversed(self._steps):
            places, followed = follow_along(NodeType.POINT, places, step.flow)
            lost |= ~followed
            to_present = to_present @ step.background
            rested = places @ to_present[:2, :2].T + to_present[:2, 2]
            ways.append(np.where(lost[:, None], np.nan, points - rested).astype(np.float32))
        return np.stack(ways)


def _centres(node_type: NodeType, geometry: Float32[np.ndarray, "n g"]) -> Float32[np.ndarray, "n 2"]:
    centres: np.ndarray = geometry.reshape(len(geometry), node_type.geometry_dim // 2, 2).mean(axis=1)
    return centres


def _background(flow: Flow, shape: tuple[int, int]) -> Float[np.ndarray, "3 3"]:
    """Where what rests goes from a flow's second frame to its first: turned, scaled and shifted, as most of it is."""
    height, width = shape
    columns, rows = np.meshgrid((np.arange(GRID[0]) + 0.5) / GRID[0], (np.arange(GRID[1]) + 0.5) / GRID[1])
    first = np.stack([columns.ravel() * width, rows.ravel() * height], axis=1).astype(np.float32) - np.float32(0.5)
    second, followed = follow_along(NodeType.POINT, first, flow)
    motion = None
    if followed.sum() >= 2:
        motion, _ = cv2.estimateAffinePartial2D(
            second[followed], first[followed], method=cv2.RANSAC, ransacReprojThreshold=1.0 / flow.scale
        )
    return np.eye(3) if motion is None else np.concatenate([motion, [[0.0, 0.0, 1.0]]])
