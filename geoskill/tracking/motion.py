"""Results of tracking the features of one frame: displacements to another frame, and long-range trajectories."""

from dataclasses import dataclass
from enum import IntEnum
from typing import final

from jaxtyping import Bool, Float, Int64
from torch import Tensor


@final
class Part(IntEnum):
    """What a feature of a demonstration belongs to, where that is known (:mod:`geoskill.tracking.known_ends`)."""

    UNKNOWN = 0
    THING = 1
    """What is carried."""
    BACKGROUND = 2
    """What rests, the target included."""
    UNRELATED = 3
    """A person, or what a person covers: it has no part in the task."""


@final
@dataclass(frozen=True, eq=False)
class Displacement:
    """Positions of a frame's ``n`` features in the other frame of a transition.

    Attributes:
        next_geometry: ``[n, g]`` in pixels; the frame's own geometry where a feature was lost.
        tracked: ``[n]``, whether the feature was tracked all the way.
        next_space: ``[n, s]`` in meters, likewise; NaN where there is no depth. None without depth.
    """

    next_geometry: Float[Tensor, "n g"]
    tracked: Bool[Tensor, " n"]
    next_space: Float[Tensor, "n s"] | None = None


@final
@dataclass(frozen=True, eq=False)
class Trajectory:
    """Positions of a frame's ``n`` features at ``a`` past frames, the anchors, and at the end of the demonstration.

    Attributes:
        anchor_xy: ``[n, a, g]`` in pixels; the frame's own geometry where unknown.
        first_known_anchor: ``[n]``, the first anchor from which on the position is known; ``a`` where it never is.
        final_xy: ``[n, g]`` in pixels, in the last frame; the frame's own geometry where unknown.
        final_known: ``[n]``, whether the final position is known.
        part: ``[n]``, the :class:`Part` of each feature.
        anchor_space: ``[n, a, s]`` in meters, likewise; NaN where there is no depth. None without depth.
        final_space: ``[n, s]``, likewise.
    """

    anchor_xy: Float[Tensor, "n a g"]
    first_known_anchor: Int64[Tensor, " n"]
    final_xy: Float[Tensor, "n g"]
    final_known: Bool[Tensor, " n"]
    part: Int64[Tensor, " n"]
    anchor_space: Float[Tensor, "n a s"] | None = None
    final_space: Float[Tensor, "n s"] | None = None
