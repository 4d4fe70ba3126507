"""Frames of a demonstration with the instances that a member selects in them."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import takewhile
from typing import final

import torch
from jaxtyping import Float, Int64
from torch import Tensor

from geoskill.data.transitions import Transitions
from geoskill.graphs.motif_graph import MotifGraph
from geoskill.model.kernel_model import KernelModel

# Frames looked at, evenly spread; instances kept of each.
MAX_FRAMES = 64
TOP_K = 4


@final
@dataclass(frozen=True, eq=False)
class SelectedFrame:
    """One frame with the instances of largest select-out.

    Attributes:
        graph: of the frame, with trajectories.
        index: ``[k, p]``, features of the selected instances, the moving node first.
        weight: ``[p]``, their select-out.
    """

    graph: MotifGraph
    index: Int64[Tensor, "k p"]
    weight: Float[Tensor, " p"]


def first_demonstration(name: str, demonstration: Transitions) -> list[MotifGraph]:
    """Return a member's graphs of the first demonstration's frames with trajectories, but of the last few frames.

    Other demonstrations show other scenes, whose pictures have no common geometry. Transitions over the shortest span
    come first, in the order of time.
    """
    graphs = (demonstration.graph_without_negatives(name, index) for index in range(len(demonstration)))
    return list(takewhile(lambda graph: int(graph.span_index) == 0, graphs))


@torch.no_grad()
def selected_frames(
    member: KernelModel, graphs: Sequence[MotifGraph], count: int = MAX_FRAMES
) -> Iterator[SelectedFrame]:
    """Yield at most ``count`` frames that have an instance, evenly spread, the last one among them.

    Args:
        member: with its final weights, in evaluation mode.
        graphs: of the frames, with instances.
        count: limit of the number of frames.
    """
    graphs = [graph for graph in graphs if graph.instance_index.shape[1] > 0]
    rows = torch.linspace(len(graphs) - 1, 0, min(count, len(graphs))).round().long().tolist()
    for graph in (graphs[row] for row in reversed(rows)):
        select_out = torch.softmax(member(graph), dim=0)
        weight, chosen = torch.topk(select_out, min(TOP_K, len(select_out)))
        index = member.moving_node_first(graph, graph.instance_index[:, chosen])
        yield SelectedFrame(graph, index, weight)
