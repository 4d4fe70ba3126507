"""Interface of the motion field: how the picture of the carried thing moves when the actor moves."""

from abc import ABC, abstractmethod
from typing import final

import numpy as np
from jaxtyping import Float64

from geoskill.control.action import Action

Points = Float64[np.ndarray, "m 2"]
PointJacobians = Float64[np.ndarray, "m 2 n"]


class ImageMotion(ABC):
    """Motion of any point of the carried thing in one camera's picture, as a function of where it is in the picture."""

    @abstractmethod
    def jacobian(self, points: Points) -> PointJacobians:
        """Return the derivative of each point's pixel with respect to the action, pixels per meter or radian."""

    @abstractmethod
    def observed(self, before: Points, after: Points, action: Action) -> "ImageMotion":
        """Return the field after features of the carried thing were seen to move.

        Args:
            before: where they were, pixels.
            after: where they are.
            action: that was carried out in between.
        """

    def displacement(self, points: Points, action: Action) -> Points:
        """Return how far each point moves with an action, pixels."""
        moved: Points = self.jacobian(points) @ action
        return moved


@final
class StillMotion(ImageMotion):
    """A field in which nothing moves, where only errors are wanted.

    Args:
        dofs: number of components of an action.
    """

    def __init__(self, dofs: int) -> None:
        self._dofs = dofs

    def jacobian(self, points: Points) -> PointJacobians:
        """See :meth:`ImageMotion.jacobian`."""
        return np.zeros((len(points), 2, self._dofs))

    def observed(self, before: Points, after: Points, action: Action) -> "StillMotion":
        """See :meth:`ImageMotion.observed`."""
        return self
