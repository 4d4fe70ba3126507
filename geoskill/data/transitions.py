"""What training learns from, be it of one demonstration or of several."""

from abc import ABC, abstractmethod
from collections.abc import Iterator

from torch import Tensor
from torch.utils.data import Dataset

from geoskill.geometry.primitives import NodeType
from geoskill.graphs.motif_graph import MotifGraph

Transition = dict[str, dict[str, MotifGraph]]


class Transitions(Dataset[Transition], ABC):
    """Transitions by number, over several spans of time, for every member of an ensemble."""

    @property
    @abstractmethod
    def spans(self) -> tuple[int, ...]:
        """The lengths of transitions in frames; a graph's ``span_index`` is a place among them."""

    @abstractmethod
    def __len__(self) -> int:
        """How many transitions there are."""

    @abstractmethod
    def __getitem__(self, index: int) -> Transition:
        """For each member, the graphs of the ``first`` and the ``second`` frame of a transition, without instances."""

    @abstractmethod
    def graph_without_negatives(self, name: str, index: int) -> MotifGraph:
        """A member's graph of a transition's first frame with what was there only, no negatives.

        Of very many features, only the instances of some.
        """

    @abstractmethod
    def frames(self, name: str) -> Iterator[MotifGraph]:
        """A member's graphs of all frames as a skill sees them: what was there, and nothing of where it went."""

    @abstractmethod
    def descriptors(self, name: str) -> dict[NodeType, Tensor]:
        """``[n, D]`` for each of a member's node types: those of all features of all frames."""
