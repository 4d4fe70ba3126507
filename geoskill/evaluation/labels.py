"""Abstract ground truth of the frames of a sequence."""

from abc import ABC, abstractmethod
from collections.abc import Sequence

from geoskill.errors import InputError
from geoskill.geometry.primitives import NodeType
from geoskill.simulation.roles import SceneRole

TOLERANCE_PX = 3.0
"""Largest distance outside a region at which a point still counts as on it. Outlines are drawn to about 1 px, and
detections on an outline lie on either side of it."""


class FrameLabels(ABC):
    """Ground truth of one frame."""

    @abstractmethod
    def label(
        self,
        point: tuple[float, float],
        tolerance_px: float = TOLERANCE_PX,
        among: Sequence[SceneRole] = tuple(SceneRole),
    ) -> SceneRole | None:
        """Return the role of the region that a point is on, or None.

        A region that contains the point takes precedence over one that is only within the tolerance; among equals, the
        one that comes first in ``among``. A point of the target 2 px from the object is on the target; a point in both,
        or outside both but within the tolerance of both, is on the object.

        Args:
            point: x, y in pixels.
            tolerance_px: largest distance to the region.
            among: regions to consider, in order of precedence.
        """

    @abstractmethod
    def at_goal(self, coordinates: Sequence[tuple[float, float]]) -> list[tuple[float, float] | None] | None:
        """Return the pixels of points of the object and the target in the frame where the task is done.

        None for a point on neither of them; None altogether when the ground truth does not include the goal.
        """

    @abstractmethod
    def feature_label(
        self,
        node_type: NodeType,
        coordinates: Sequence[float],
        tolerance_px: float = TOLERANCE_PX,
        among: Sequence[SceneRole] = tuple(SceneRole),
    ) -> SceneRole | None:
        """Return the role of the region that a feature is on, mostly that of its center; see :meth:`label`.

        Args:
            node_type: type of the feature.
            coordinates: in pixels, as :mod:`geoskill.geometry.primitives` has them.
            tolerance_px: see :meth:`label`.
            among: see :meth:`label`.
        """

    @abstractmethod
    def feature_at_goal(
        self, node_type: NodeType, coordinates: Sequence[float], space: Sequence[float] | None, in_space: bool
    ) -> tuple[float, ...] | None:
        """Return the coordinates of a feature of the object or the target where the task is done.

        Args:
            node_type: type of the feature.
            coordinates: in pixels.
            space: as measured in space, in the camera's frame; a plane needs it.
            in_space: whether coordinates in space are wanted, meters in the camera's frame of this frame.

        Returns:
            None for a feature on neither of them, and when the ground truth does not include the goal.
        """

    @property
    @abstractmethod
    def goal_pixel_m(self) -> float | None:
        """Width of a pixel at the object when the task is done, in meters; None when it is unknown."""


class Labels(ABC):
    """Ground truth of a sequence.

    Attributes:
        name: name of the ground truth, for messages.
    """

    name: str

    @property
    @abstractmethod
    def first_frame(self) -> int:
        """Smallest number of a labeled frame."""

    @property
    @abstractmethod
    def last_frame(self) -> int:
        """Largest number of a labeled frame."""

    @abstractmethod
    def at(self, frame: int) -> FrameLabels | None:
        """Return the labels of a frame, or None when it has none."""

    @abstractmethod
    def require_size(self, image_size: tuple[int, int]) -> None:
        """Raise InputError unless ``image_size``, width and height of the video in pixels, is that of the labels."""

    def require_evaluated(self, frame_count: int, every: int) -> None:
        """Raise InputError unless at least one of the frames to evaluate has labels.

        Args:
            frame_count: number of frames of the video.
            every: frames 0, every, 2 * every, ... are evaluated.
        """
        if not any(self.first_frame <= frame <= self.last_frame for frame in range(0, frame_count, every)):
            raise InputError(
                f"{self.name}: labels frames {self.first_frame} to {self.last_frame}; expected them to cover some of "
                f"the {frame_count} frames of the video that were to be evaluated (every={every})"
            )
