"""Whether associations come together at a demonstration's end beyond chance, from tracks alone, before any training.

::

    coincide   instances of one moving and one resting node that have lost much of their error, and end within what
               counts as the same place
    chance     the same, after a random rigid motion of everything that moved: turned about its middle by any angle but
               near right ones, and shifted by up to its own size

Any two textured things have points and edges that meet somewhere. Only what a random motion would undo says that the
demonstration is about it (docs/experiments/auto.md).
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, final

import torch
from jaxtyping import Float, Int64
from torch import Tensor

from geoskill.geometry.control_errors import error_norm
from geoskill.geometry.primitives import NodeType
from geoskill.graphs.motif_graph import MotifGraph
from geoskill.kernels.kernel import Kernel
from geoskill.model.kernel_model import KernelModel
from geoskill.objective.goal import SAME_PLACE, UNRELATED_PROGRESS, goal_progress
from geoskill.training.error_changes import errors_at_ends, instance_goal_progress
from geoskill.training.evidence import MUCH_PROGRESS

NUM_MOTIONS: Final = 99
MIN_TRAVEL: Final = 4.0
"""Pixels; what goes less far rests, as far as detection and tracking can tell."""
MIN_TURN: Final = math.radians(15)
"""Random turns are so far from right angles, which bring the edges of most made things together again."""
MAX_REST_SHARE: Final = 0.5
"""A node rests when it goes less far than this share of what the moving one goes."""


@final
@dataclass(frozen=True, eq=False)
class Coincidences:
    """What one frame says of one member.

    Attributes:
        progress: the largest goal progress of its instances; 0 without any.
        chance: share of the random motions after which as many instances coincide as at the end, in (0, 1]; 1 where
            none does.
    """

    progress: float
    chance: float


NOTHING: Final = Coincidences(0.0, 1.0)


def coincidences(member: KernelModel, graph: MotifGraph, generator: torch.Generator) -> Coincidences:
    """Compare how many associations of a frame come together with how many would by chance.

    Args:
        member: gives kernel and extractors.
        graph: one frame with instances and trajectories.
        generator: draws the random motions.
    """
    pairs = _Pairs.of(member, graph)
    if pairs is None:
        return NOTHING
    observed = int(pairs.count(torch.zeros(1, 3))[0])
    as_many = int((pairs.count(pairs.random_motions(generator)) >= observed).sum())
    chance = (1 + as_many) / (1 + NUM_MOTIONS)  # the motion that was seen is one of them (Davison and Hinkley 1997)
    return Coincidences(float(pairs.progress.max()), chance)


@final
@dataclass(frozen=True, eq=False)
class _Pairs:
    """Instances of one moving node and resting ones, whose ends are known.

    Attributes:
        kernel: gives the error.
        ends: geometry of their nodes at the end, ``[m, g]`` by role.
        mover: ``[m]``, which node moves.
        before: ``[m]``, norms of their errors before.
        progress: ``[m]``, their goal progress.
        middle: ``[2]``, of what moves, at the end.
        size: root mean square distance of what moves from its middle, in pixels.
    """

    kernel: Kernel
    ends: Sequence[Float[Tensor, "m _"]]
    mover: Int64[Tensor, " m"]
    before: Float[Tensor, " m"]
    progress: Float[Tensor, " m"]
    middle: Float[Tensor, "2"]
    size: float

    @classmethod
    def of(cls, member: KernelModel, graph: MotifGraph) -> "_Pairs | None":
        """Return those of a frame, or None where there is none."""
        if graph.instance_index.shape[1] == 0:
            return None
        travels = torch.stack(
            [_travels(graph, role)[row] for role, row in zip(member.kernel.roles, graph.instance_index, strict=True)]
        )
        farthest, mover = travels.max(dim=0)
        resting = (travels <= MAX_REST_SHARE * farthest).sum(dim=0) == len(travels) - 1
        progress, (before, _) = instance_goal_progress(member, graph), errors_at_ends(member, graph)
        chosen = resting & (farthest >= MIN_TRAVEL) & (progress > UNRELATED_PROGRESS)
        if not chosen.any():
            return None
        index, mover = graph.instance_index[:, chosen], mover[chosen]
        ends = [graph[f"{role}_final_xy"][row] for role, row in zip(member.kernel.roles, index, strict=True)]
        moving = torch.cat([end[mover == node].reshape(-1, 2) for node, end in enumerate(ends)])
        middle = moving.mean(dim=0)
        size = float((moving - middle).square().sum(dim=1).mean().sqrt())
        return cls(member.kernel, ends, mover, before[chosen], progress[chosen], middle, size)

    def errors(self, motions: Float[Tensor, "n 3"]) -> Float[Tensor, "nm d"]:
        """Return the errors of all instances after the first motion, then after the second, and so on.

        Args:
            motions: shifts ``[:, :2]`` in pixels, and turns ``[:, 2]`` in radians.
        """
        nodes = []
        for node, end in enumerate(self.ends):
            moved = _moved(end, motions, self.middle)
            still = end.expand_as(moved)
            nodes.append(torch.where((self.mover == node)[None, :, None], moved, still).flatten(0, 1))
        return self.kernel.control_error(nodes)

    def count(self, motions: Float[Tensor, "n 3"]) -> Int64[Tensor, " n"]:
        """Return how many coincide after each motion."""
        after = error_norm(self.errors(motions))
        known, before = torch.ones_like(after, dtype=torch.bool), self.before.repeat(len(motions))
        progress = goal_progress(before, after, known, self.kernel.resolution)
        near = after <= SAME_PLACE * self.kernel.resolution
        return (near & (progress >= MUCH_PROGRESS)).reshape(len(motions), len(self.mover)).sum(dim=1)

    def random_motions(self, generator: torch.Generator) -> Float[Tensor, "n 3"]:
        """Draw motions: turns by any angle but near right ones, shifts evenly over a disk."""
        radius, direction, share, quarter = torch.rand(4, NUM_MOTIONS, generator=generator)
        radius, direction = self.size * radius.sqrt(), 2 * math.pi * direction
        turn = (4 * quarter).floor() * (math.pi / 2) + MIN_TURN + share * (math.pi / 2 - 2 * MIN_TURN)
        return torch.stack([radius * direction.cos(), radius * direction.sin(), turn], dim=1)


def _travels(graph: MotifGraph, role: NodeType) -> Float[Tensor, " n"]:
    """Return how far each feature goes in the picture: to its end from where it is first known, or from the frame.

    One whose end is not known goes nowhere for sure, which is no number.
    """
    now, final, anchors = (graph[f"{role}_{name}"] for name in ("geometry", "final_xy", "anchor_xy"))
    first = graph[f"{role}_first_known_anchor"]
    known = (first < anchors.shape[1])[:, None]
    began = torch.where(known, anchors[torch.arange(len(now)), first.clamp_max(anchors.shape[1] - 1)], now)
    ways = [_middles(final) - _middles(start) for start in (began, now)]
    travels = torch.stack([way.norm(dim=1) for way in ways]).amax(dim=0)
    return torch.where(graph[f"{role}_final_known"], travels, torch.full_like(travels, torch.nan))


def _middles(geometry: Float[Tensor, "n g"]) -> Float[Tensor, "n 2"]:
    middles: Tensor = geometry.reshape(len(geometry), geometry.shape[1] // 2, 2).mean(dim=1)
    return middles


def _moved(
    geometry: Float[Tensor, "m g"], motions: Float[Tensor, "n 3"], middle: Float[Tensor, "2"]
) -> Float[Tensor, "n m g"]:
    """Return points or segments after each motion, turned about the middle and then shifted."""
    cosine, sine = motions[:, 2].cos(), motions[:, 2].sin()
    turn = torch.stack([torch.stack([cosine, -sine], dim=1), torch.stack([sine, cosine], dim=1)], dim=1)
    points = geometry.reshape(len(geometry), geometry.shape[1] // 2, 2) - middle
    moved = torch.einsum("nij,mpj->nmpi", turn, points) + middle + motions[:, None, None, :2]
    return moved.flatten(2)
