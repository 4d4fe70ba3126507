"""Several demonstrations of one task, one after the other, as if they were one."""

from bisect import bisect_right
from collections.abc import Collection, Iterator, Sequence
from itertools import accumulate
from typing import final

import torch
from torch import Tensor

from geoskill.data.demonstration import Demonstration
from geoskill.data.transitions import Transition, Transitions
from geoskill.features.preference import FeaturePreference, merged
from geoskill.geometry.primitives import NodeType
from geoskill.graphs.motif_graph import MotifGraph


@final
class Demonstrations(Transitions):
    """The transitions of several demonstrations.

    The task is common to all of them; backgrounds, hands and paths differ. Features are tracked within a demonstration
    only. A step draws from all, from longer ones more often in proportion to their number of transitions.

    Args:
        demonstrations: at least one, of the same members, pipelines and gap. Spans double from the gap up, so that
            those of a shorter demonstration are the first ones of a longer.

    Raises:
        ValueError: when there is no demonstration, or their gaps differ.
    """

    def __init__(self, demonstrations: Sequence[Demonstration]) -> None:
        if not demonstrations:
            raise ValueError("no demonstration; expected at least one")
        self._demonstrations = list(demonstrations)
        self._spans = max((demonstration.spans for demonstration in demonstrations), key=len)
        for demonstration in demonstrations:
            if demonstration.spans != self._spans[: len(demonstration.spans)]:
                raise ValueError(f"spans of {demonstration.spans} and {self._spans} frames; expected the same gap")
        self._ends = list(accumulate(len(demonstration) for demonstration in demonstrations))

    @property
    def preferences(self) -> dict[str, FeaturePreference]:
        """Which features of other frames of the task to keep, by the extractor's name, where this is known."""
        names = dict.fromkeys(name for own in self._demonstrations for name in own.preferences)
        return {
            name: merged([own.preferences[name] for own in self._demonstrations if name in own.preferences])
            for name in names
        }

    def keep(self, names: Collection[str]) -> None:
        """Forget all members but these; see :meth:`Demonstration.keep`."""
        for demonstration in self._demonstrations:
            demonstration.keep(names)

    def _locate(self, index: int) -> tuple[Demonstration, int]:
        """Return the demonstration of a transition, and its index there."""
        if not 0 <= index < len(self):
            raise IndexError(f"transition {index}; expected 0 to {len(self) - 1}")
        number = bisect_right(self._ends, index)
        return self._demonstrations[number], index - (self._ends[number - 1] if number else 0)

    @property
    def spans(self) -> tuple[int, ...]:
        """Those of the longest demonstration; see :attr:`Transitions.spans`."""
        return self._spans

    def __len__(self) -> int:
        return self._ends[-1]

    def __getitem__(self, index: int) -> Transition:
        """Return a transition; see :meth:`Transitions.__getitem__`."""
        demonstration, own_index = self._locate(index)
        return demonstration[own_index]

    def graph_without_negatives(self, name: str, index: int) -> MotifGraph:
        """Return a frame's graph; see :meth:`Transitions.graph_without_negatives`."""
        demonstration, own_index = self._locate(index)
        return demonstration.graph_without_negatives(name, own_index)

    def frames(self, name: str) -> Iterator[MotifGraph]:
        """Yield the frames' graphs; see :meth:`Transitions.frames`."""
        for demonstration in self._demonstrations:
            yield from demonstration.frames(name)

    def descriptors(self, name: str) -> dict[NodeType, Tensor]:
        """Return all descriptors; see :meth:`Transitions.descriptors`."""
        descriptors = [demonstration.descriptors(name) for demonstration in self._demonstrations]
        return {node_type: torch.cat([rows[node_type] for rows in descriptors]) for node_type in descriptors[0]}
