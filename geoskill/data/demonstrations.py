"""Several demonstrations of one task, one after the other, as if they were one."""

from bisect import bisect_right
from collections.abc import Iterator, Sequence
from itertools import accumulate
from typing import final

import torch
from torch import Tensor

from geoskill.data.demonstration import Demonstration
from geoskill.data.transitions import Transition, Transitions
from geoskill.geometry.primitives import NodeType
from geoskill.graphs.motif_graph import MotifGraph


@final
class Demonstrations(Transitions):
    """The transitions of all of them.

    What is common to all is the task; backgrounds, hands and ways differ. Each demonstration is followed by itself, and
    nothing is followed from one to another. A step draws from all, a longer one as much more often as it has more
    transitions.

    Args:
        parts: at least one, of the same members, pipelines and gap. Spans double from the gap up, so that those of the
            shorter are the first ones of the longer.

    Raises:
        ValueError: when there is none, or they have other gaps.
    """

    def __init__(self, parts: Sequence[Demonstration]) -> None:
        if not parts:
            raise ValueError("no demonstration; expected at least one")
        self.parts = list(parts)
        self._spans = max((part.spans for part in parts), key=len)
        for part in parts:
            if part.spans != self._spans[: len(part.spans)]:
                raise ValueError(f"spans of {part.spans} and {self._spans} frames; expected the same gap")
        self._ends = list(accumulate(len(part) for part in parts))

    def _place(self, index: int) -> tuple[Demonstration, int]:
        if not 0 <= index < len(self):
            raise IndexError(f"transition {index}; expected 0 to {len(self) - 1}")
        which = bisect_right(self._ends, index)
        return self.parts[which], index - (self._ends[which - 1] if which else 0)

    @property
    def spans(self) -> tuple[int, ...]:
        """See :attr:`Transitions.spans`: those of the longest."""
        return self._spans

    def __len__(self) -> int:
        return self._ends[-1]

    def __getitem__(self, index: int) -> Transition:
        """See :meth:`Transitions.__getitem__`."""
        part, place = self._place(index)
        return part[place]

    def graph_without_negatives(self, name: str, index: int) -> MotifGraph:
        """See :meth:`Transitions.graph_without_negatives`."""
        part, place = self._place(index)
        return part.graph_without_negatives(name, place)

    def frames(self, name: str) -> Iterator[MotifGraph]:
        """See :meth:`Transitions.frames`."""
        for part in self.parts:
            yield from part.frames(name)

    def descriptors(self, name: str) -> dict[NodeType, Tensor]:
        """See :meth:`Transitions.descriptors`."""
        found = [part.descriptors(name) for part in self.parts]
        return {kind: torch.cat([each[kind] for each in found]) for kind in found[0]}
