"""Pairs that were picked in the first picture and are followed by trackers: the usual way to servo without a skill."""

from collections.abc import Sequence
from dataclasses import replace
from typing import final

import cv2
import numpy as np

from geoskill.control.rows import Constraint
from geoskill.geometry.primitives import NodeType
from geoskill.simulation.sensor import Image
from geoskill.tracking.flow import track_sparse


@final
class TrackedPairs:
    """Pairs of points of one camera, by optical flow; one that is lost does not come back."""

    def __init__(self) -> None:
        self._pairs: list[Constraint] | None = None
        self._last: np.ndarray | None = None

    def advance(self, frame: Image, picked: Sequence[Constraint]) -> list[Constraint]:
        """Return the pairs in the next picture.

        Args:
            frame: the picture, RGB.
            picked: pairs by hand; only those of the first picture that has some count.
        """
        gray = np.asarray(cv2.cvtColor(frame, cv2.COLOR_RGB2GRAY), np.uint8)
        last, self._last = self._last, gray
        if self._pairs is None or last is None:
            self._pairs = list(picked) or None
            return list(picked)
        if not self._pairs:
            return []
        points = np.array([node for pair in self._pairs for node in pair.nodes], np.float32)
        places, found = track_sparse(NodeType.POINT, points, last, gray)
        count = len(self._pairs[0].nodes)
        self._pairs = [
            replace(pair, nodes=tuple(np.asarray(own, np.float64)))
            for pair, own, kept in zip(
                self._pairs, places.reshape(-1, count, 2), map(all, found.reshape(-1, count)), strict=True
            )
            if kept
        ]
        return list(self._pairs)
