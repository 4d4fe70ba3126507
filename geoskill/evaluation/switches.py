"""How often a skill changes its mind: switches of the top association that the scene did not ask for.

The nodes of the top association are followed by optical flow from one judged frame to the next. Only where all of them
arrive, so that the association could have been kept, is the transition comparable; it is a switch when the next top
association joins other features.
"""

from dataclasses import dataclass
from functools import partial
from typing import final

import numpy as np
from jaxtyping import UInt8

from geoskill.kernels.kernel import Kernel
from geoskill.skill.association import Association, Node, follow_nodes
from geoskill.skill.matching import is_same_association
from geoskill.tracking.flow import track_between


@final
@dataclass(frozen=True)
class SwitchCount:
    """Transitions that could be compared, and how many of them were switches."""

    switches: int
    comparable: int


@final
class SwitchCounter:
    """Counts the switches of one ensemble member along a sequence, keeping no more than one frame.

    Every frame of the sequence goes through :meth:`advance`. On those to be judged, :meth:`judge` follows it. Frames in
    between are stepping stones: nodes are followed from frame to frame, since flow fails over the long way that things
    move in many frames.

    Args:
        kernel: the member's kernel.
    """

    def __init__(self, kernel: Kernel) -> None:
        self._kernel = kernel
        self._image: UInt8[np.ndarray, "height width 3"] | None = None
        self._followed: tuple[Node, ...] | None = None
        self._switches = 0
        self._comparable = 0

    @property
    def count(self) -> SwitchCount:
        """The sum so far."""
        return SwitchCount(self._switches, self._comparable)

    def advance(self, image: UInt8[np.ndarray, "height width 3"]) -> None:
        """Goes on to the next RGB frame, following the nodes of the last top association if they are still there."""
        if self._followed is not None and self._image is not None:
            self._followed = follow_nodes(self._followed, partial(track_between, start=self._image, end=image))
        self._image = image

    def judge(self, top: Association | None) -> bool | None:
        """Whether the top association of this frame is a switch.

        None where the transition is not comparable: on the first judged frame, when a node was lost on the way, or when
        this frame or the one judged before has no association.
        """
        before, self._followed = self._followed, None if top is None else top.nodes
        if before is None or top is None:
            return None
        switched = not is_same_association(self._kernel, before, top.nodes)
        self._switches += switched
        self._comparable += 1
        return switched
