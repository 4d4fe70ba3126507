"""Interface of what is controlled: an actor that holds something, and cameras that look at it."""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import final

from geoskill.control.action import Action
from geoskill.control.state import Sighting


@final
@dataclass(frozen=True)
class Placement:
    """How far the carried thing is from where it belongs, by the ground truth.

    Attributes:
        mm: distance, millimeters.
        along_mm: the part of it along the first camera's line of sight.
        across_mm: the part of it across that line.
        deg: angle, degrees.
    """

    mm: float
    along_mm: float
    across_mm: float
    deg: float


class Plant(ABC):
    """One trial: something in the actor's grip that has to go to its goal."""

    @abstractmethod
    def look(self) -> Sighting:
        """Return what is seen now, and what was carried out since the last look."""

    @abstractmethod
    def act(self, action: Action) -> None:
        """Carry out the displacement of one step, as well as the actor can."""

    @abstractmethod
    def placement(self) -> Placement:
        """Return where the carried thing is, by the ground truth, which the loop does not know."""

    def released(self) -> Placement:
        """Let the thing go, where that is simulated, and return where it comes to rest."""
        return self.placement()

    def wrong_associations(self) -> int:
        """Return in how many pictures so far the first association was wrong, where that is known; 0 otherwise."""
        return 0
