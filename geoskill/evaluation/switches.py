"""Switches: changes of the top association although the previous one could have been kept.

The nodes of the top association are tracked by optical flow from one evaluated frame to the next. The transition is
comparable only if all of them can be tracked; it is a switch when the next top association joins other features.
"""

from dataclasses import dataclass
from functools import partial
from typing import final

import numpy as np
from jaxtyping import UInt8

from geoskill.kernels.kernel import Kernel
from geoskill.skill.association import Association, Node, track_nodes
from geoskill.skill.matching import is_same_association
from geoskill.tracking.flow import track_between


@final
@dataclass(frozen=True)
class SwitchCount:
    """Number of comparable transitions, and how many of them were switches."""

    switches: int
    comparable: int


@final
class SwitchCounter:
    """Counter of the switches of one ensemble member along a sequence.

    Call :meth:`advance` on every frame of the sequence, and :meth:`evaluate` after it on the frames to evaluate. Nodes
    are tracked through the frames in between, since flow fails when things move far from one image to the next. No more
    than one frame is kept in memory.

    Args:
        kernel: kernel of the member.
    """

    def __init__(self, kernel: Kernel) -> None:
        self._kernel = kernel
        self._image: UInt8[np.ndarray, "height width 3"] | None = None
        self._tracked: tuple[Node, ...] | None = None
        self._switches = 0
        self._comparable = 0

    @property
    def count(self) -> SwitchCount:
        """Count so far."""
        return SwitchCount(self._switches, self._comparable)

    def advance(self, image: UInt8[np.ndarray, "height width 3"]) -> None:
        """Go on to the next RGB frame, and track the nodes of the last evaluated top association to it."""
        if self._tracked is not None and self._image is not None:
            self._tracked = track_nodes(self._tracked, partial(track_between, start=self._image, end=image))
        self._image = image

    def evaluate(self, top: Association | None) -> bool | None:
        """Return whether the top association of the current frame is a switch.

        None when the transition is not comparable: on the first evaluated frame, when a node was lost on the way, or
        when this frame or the one evaluated before has no association.
        """
        previous, self._tracked = self._tracked, None if top is None else top.nodes
        if previous is None or top is None:
            return None
        switched = not is_same_association(self._kernel, previous, top.nodes)
        self._switches += switched
        self._comparable += 1
        return switched
