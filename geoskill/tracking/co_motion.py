"""Common fate: features that have lately moved as one belong to one thing, and nobody is bringing them together.

What a hand or a gripper carries moves with it, so of two nodes that went the same way against the background neither is
the other's target, however much their descriptors look like it. Nothing is said of nodes that rest, for so does the
object before it is grasped, of what moves slowly, and of what has paused for longer than the window. (The law of common
fate is Wertheimer's, 1923.)
"""

from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import final

import cv2
import numpy as np
from jaxtyping import Bool, Float, Float32, Int, UInt8

from geoskill.geometry.primitives import NodeType
from geoskill.kernels.kernel import Kernel
from geoskill.tracking.flow import Flow, gray_flow, track_dense

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
# Shorter side in pixels at which frames are compared: half of VGA, at which flow takes 3 ms of a core. Smaller frames
# are enlarged: flow is smooth over some pixels, and would take along what rests beside a thing that moves.
WORKING_SIDE = 240
# Places, in columns and rows, of which at least this share has to move alike to be the background. So a thing that
# fills most of the picture is taken for it, and what is near does not rest when the camera travels past it. The share
# is 0.8 to 1 in the median, real and simulated; were 0.75 asked for, a quarter of the steps of some would be lost.
GRID = (20, 15)
LEAST_BACKGROUND = 0.5


@final
@dataclass(frozen=True, eq=False)
class _Step:
    """From a frame to the one before it.

    Attributes:
        flow: of everything.
        background: takes homogeneous pixels of what rests from the frame before to this one; None if that is unclear.
    """

    flow: Flow
    background: Float[np.ndarray, "3 3"] | None


@final
class CoMotionDetector:
    """How things in a video have moved of late, as the flow from each frame of a window to the one before it."""

    def __init__(self) -> None:
        self._shape = (0, 0)
        self._small: UInt8[np.ndarray, "_ _"] | None = None
        self._steps: deque[_Step] = deque(maxlen=WINDOW)

    def advance(self, gray: UInt8[np.ndarray, "height width"]) -> None:
        """Goes on to the next frame; one of another size begins anew."""
        height, width = gray.shape
        # A strip of a picture is not enlarged beyond what other pictures become.
        scale = min(WORKING_SIDE / min(height, width), max(1.0, 2 * WORKING_SIDE / max(height, width)))
        size = (max(1, round(width * scale)), max(1, round(height * scale)))
        small = np.asarray(cv2.resize(gray, size, interpolation=cv2.INTER_AREA), np.uint8)
        if (height, width) != self._shape:
            self._steps.clear()
        elif self._small is not None:
            flow = replace(gray_flow(small, self._small, cv2.DISOPTICAL_FLOW_PRESET_FAST), scale=scale)
            self._steps.append(_Step(flow, _background(flow, gray.shape)))
        self._shape, self._small = (height, width), small

    def co_moving(
        self,
        kernel: Kernel,
        geometry: Mapping[NodeType, Float32[np.ndarray, "n _"]],
        instances: Int[np.ndarray, "k m"],
    ) -> Bool[np.ndarray, " m"]:
        """Which instances of a kernel have nodes that all moved the same way, as far back as all can be followed.

        Args:
            kernel: gives the nodes' types.
            geometry: of the present frame's features, in its pixels.
            instances: the features of each instance, one row for each node.
        """
        if self._small is None:
            raise ValueError("no frame has been shown; expected advance() first")
        ways = {kind: self._ways(kind, rows) for kind, rows in geometry.items()}
        farthest = {kind: (~np.isnan(way[:, :, 0])).sum(axis=0) - 1 for kind, way in ways.items()}
        least_px = LEAST_WAY * min(self._shape)
        # The shorter way of a pair that moved as one is nearly as long as the longer one. Of many features most rest,
        # and those need not be compared with all others.
        shorter_px = (1 - LARGEST_DIFFERENCE) * least_px
        moving = {kind: (np.linalg.norm(way, axis=2) > shorter_px).any(axis=0) for kind, way in ways.items()}
        nodes = list(zip(kernel.roles, instances, strict=True))
        (compared,) = np.all([moving[kind][features] for kind, features in nodes], axis=0).nonzero()
        frames_ago = np.min([farthest[kind][features[compared]] for kind, features in nodes], axis=0)
        of_nodes = np.stack([ways[kind][frames_ago, features[compared]] for kind, features in nodes])
        longest = np.linalg.norm(of_nodes, axis=2).max(axis=0)
        difference = np.linalg.norm(of_nodes[:, None] - of_nodes[None], axis=3).max(axis=(0, 1))
        as_one = np.zeros(instances.shape[1], bool)
        as_one[compared] = (longest > least_px) & (difference <= LARGEST_DIFFERENCE * longest)
        return as_one

    def _ways(self, node_type: NodeType, geometry: Float32[np.ndarray, "n _"]) -> Float32[np.ndarray, "w n 2"]:
        """By how much features, lines by their midpoints, have moved against the background since 0, 1, ... frames ago.

        In pixels, from where they would be had they rested; NaN for frames to which one cannot be followed back.
        """
        present, past = _centers(node_type, geometry), geometry
        lost = np.zeros(len(geometry), bool)
        to_present = np.eye(3)
        ways = [np.zeros_like(present)]
        for step in reversed(self._steps):
            if step.background is None:
                break
            past, followed = track_dense(node_type, past, step.flow)
            lost |= ~followed
            to_present = to_present @ step.background
            had_it_rested = _centers(node_type, past) @ to_present[:2, :2].T + to_present[:2, 2]
            ways.append(np.where(lost[:, None], np.nan, present - had_it_rested).astype(np.float32))
        return np.stack(ways)


def _centers(node_type: NodeType, geometry: Float32[np.ndarray, "n g"]) -> Float32[np.ndarray, "n 2"]:
    centers: np.ndarray = geometry.reshape(len(geometry), node_type.geometry_dim // 2, 2).mean(axis=1)
    return centers


def _background(flow: Flow, shape: tuple[int, int]) -> Float[np.ndarray, "3 3"] | None:
    """The background of a :class:`_Step`: how most of the picture is turned, scaled and shifted."""
    height, width = shape
    columns, rows = np.meshgrid((np.arange(GRID[0]) + 0.5) / GRID[0], (np.arange(GRID[1]) + 0.5) / GRID[1])
    present = np.stack([columns.ravel() * width, rows.ravel() * height], axis=1).astype(np.float32) - np.float32(0.5)
    before, followed = track_dense(NodeType.POINT, present, flow)
    if followed.sum() < 2:
        return None
    motion, resting = cv2.estimateAffinePartial2D(
        before[followed], present[followed], method=cv2.RANSAC, ransacReprojThreshold=1.0 / flow.scale
    )
    if motion is None or resting.mean() < LEAST_BACKGROUND:
        return None
    return np.concatenate([motion, [[0.0, 0.0, 1.0]]])
