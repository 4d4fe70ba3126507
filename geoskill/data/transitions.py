"""The interface of training data, whether it comes from one demonstration or from several."""

from abc import ABC, abstractmethod
from collections.abc import Iterator

from torch import Tensor
from torch.utils.data import Dataset

from geoskill.geometry.primitives import NodeType
from geoskill.graphs.motif_graph import MotifGraph

# For each member, the graphs of the ``first`` and the ``second`` frame.
Transition = dict[str, dict[str, MotifGraph]]


class Transitions(Dataset[Transition], ABC):
    """Transitions by number, over several spans of time, for every member of an ensemble."""

    @property
    @abstractmethod
    def spans(self) -> tuple[int, ...]:
        """The lengths of transitions in frames; a graph's ``span_index`` is an index into them."""

    @abstractmethod
    def __len__(self) -> int:
        """Return the number of transitions."""

    @abstractmethod
    def __getitem__(self, index: int) -> Transition:
        """Return both frames of a transition as graphs without instances."""

    @abstractmethod
    def graph_without_negatives(self, name: str, index: int) -> MotifGraph:
        """Return a member's graph of a transition's first frame with instances and without negatives.

        It has instances of a subset of the features when there are very many.
        """

    @abstractmethod
    def frames(self, name: str) -> Iterator[MotifGraph]:
        """Yield a member's graphs of all frames as a skill sees them: without negatives and without motion."""

    @abstractmethod
    def descriptors(self, name: str) -> dict[NodeType, Tensor]:
        """Return the descriptors ``[n, D]`` of all features of all frames, for each of a member's node types."""
