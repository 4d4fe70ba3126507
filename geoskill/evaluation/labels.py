"""What every kind of ground truth says about the frames of a sequence."""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from enum import StrEnum
from typing import final

from geoskill.errors import InputError

TOLERANCE_PX = 3.0
"""How far outside a region a point still counts as on it. Outlines are drawn to about 1 px, and detectors place what
they find on an outline to either side of it."""


@final
class Region(StrEnum):
    """What a part of the picture shows, in the order in which overlapping ones take precedence.

    HAND is whoever moves the object, a robot's gripper too.
    """

    OBJECT = "object"
    TARGET = "target"
    HAND = "hand"


class FrameLabels(ABC):
    """The ground truth of one frame."""

    @abstractmethod
    def label(
        self, point: tuple[float, float], tolerance_px: float = TOLERANCE_PX, among: Sequence[Region] = tuple(Region)
    ) -> Region | None:
        """The one region of ``among`` that a point belongs to, or None.

        Two rules, the first before the second: a region that the point lies in goes before one that is only within the
        tolerance; and in the order of ``among`` one region goes before the next. A point of the target 2 px from the
        object is on the target, one in the overlap of both is on the object, and one outside both but within the
        tolerance of both is on the object too.
        """

    @abstractmethod
    def at_goal(self, coordinates: Sequence[tuple[float, float]]) -> list[tuple[float, float] | None] | None:
        """Where points of the object and the target appear when the task is done; None for points of other things.

        None altogether where the ground truth does not know.
        """

    @property
    @abstractmethod
    def goal_pixel_m(self) -> float | None:
        """How many meters a pixel is wide at the object when the task is done, or None where that is not known."""


class Labels(ABC):
    """The ground truth of a sequence.

    Attributes:
        name: of the ground truth, for messages.
    """

    name: str

    @property
    @abstractmethod
    def first_frame(self) -> int:
        """The smallest number of a labeled frame."""

    @property
    @abstractmethod
    def last_frame(self) -> int:
        """The largest number of a labeled frame."""

    @abstractmethod
    def at(self, frame: int) -> FrameLabels | None:
        """The labels of a frame, or None where there are none."""

    @abstractmethod
    def require_size(self, image_size: tuple[int, int]) -> None:
        """Raises InputError unless ``image_size``, the width and height of the video, is that of the labels."""

    def require_judged(self, frame_count: int, every: int) -> None:
        """Raises InputError unless some of the frames 0, every, 2 * every, ... of so many has labels."""
        if not any(self.first_frame <= frame <= self.last_frame for frame in range(0, frame_count, every)):
            raise InputError(
                f"{self.name}: labels frames {self.first_frame} to {self.last_frame}; expected them to cover some of "
                f"the {frame_count} frames of the video that were to be judged (every={every})"
            )
