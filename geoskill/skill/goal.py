"""Where the moving nodes of an association belong in a frame, and the error that is left until there.

In the demonstration's last frames, the moving features lay somewhere on their target. These places go to the present
frame by the map of the target's features between the two pictures, anchored at the association's own resting node
(:mod:`geoskill.geometry.anchored_map`)::

    goal error = E(moving, resting) - E(T moving*, resting)

with T the map and moving* the geometry of the moving node at the demonstration's end. E is the kernel's own control
error, so this holds for every kernel. Whatever cannot be told for sure has no goal error.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, final

import numpy as np
import torch
from jaxtyping import Float, Float32, Float64, Int64
from torch import Tensor

from geoskill.geometry.anchored_map import Matches, anchored_map, mapped, residuals
from geoskill.geometry.primitives import NodeType, centers
from geoskill.geometry.segments import DEGENERATE_LENGTH_PX, length, midpoint
from geoskill.geometry.uncertainty import propagated_std
from geoskill.graphs.motif_graph import MotifGraph
from geoskill.kernels.kernel import directed_nodes
from geoskill.model.kernel_model import KernelModel
from geoskill.skill.association import Goal, Node
from geoskill.skill.matching import TOLERANCE_PX

SURE_SHARE: Final = 0.5
"""A feature is recognized by itself when its descriptor differs by less than this share of what similar ones may."""
LOOK_ALIKE_SHARE: Final = 0.3
"""Features whose differences differ by less than this share of what similar ones may cannot be told apart."""
MAX_STRETCH: Final = 1.5
"""A goal that is farther from the resting node than nearly all stored ones, by this factor, is none."""
MAX_CANDIDATES: Final = 3
"""Possible matches of one feature that are tried."""
MIN_AGREEMENT: Final = 0.7
"""Share of the stored features that look the same, which have to end at one place."""

Places = tuple[tuple[float, ...] | None, ...]
"""Geometry of each moving node at the goal, in pixels of a frame; None for resting nodes."""


@final
class GoalFinder:
    """Goals of the associations of one member in one frame.

    Args:
        member: with its goal reference.
        graph: of the frame.
    """

    def __init__(self, member: KernelModel, graph: MotifGraph) -> None:
        self._member, self._reference = member, member.goal
        self._maps: dict[int, Float64[np.ndarray, "3 3"] | None] = {}
        self._distinct: list[Float64[np.ndarray, "3 3"]] = []
        self._descriptors = {kind: _array(rows) for kind, rows in member.attribute(graph, "descriptor").items()}
        self._geometry = {kind: _array(rows) for kind, rows in member.attribute(graph, "geometry").items()}
        self._matches: dict[NodeType, Matches] = {}
        self._stored: dict[int, _StoredEnds] = {}
        self._ends: dict[tuple[int, int], Float64[np.ndarray, " g"] | None] = {}
        self._usual_px: dict[int, float] = {}

    def goals(
        self, features: Sequence[Sequence[int]], nodes: Sequence[Sequence[Node]], axis: Float[Tensor, "2"]
    ) -> list[Goal | None]:
        """Return the goals of associations, None where one cannot be told.

        Args:
            features: of the nodes of each association, in this frame.
            nodes: of each association, the moving one first, directed.
            axis: by which they were directed.
        """
        places = [
            self._places(own_features, own_nodes) for own_features, own_nodes in zip(features, nodes, strict=True)
        ]
        known = [row for row, own in enumerate(places) if own is not None]
        found = goals_of(self._member, [nodes[row] for row in known], [places[row] or () for row in known], axis)
        goals: list[Goal | None] = [None] * len(nodes)
        for row, goal in zip(known, found, strict=True):
            goals[row] = goal
        return goals

    def _places(self, features: Sequence[int], nodes: Sequence[Node]) -> Places | None:
        """Return where the moving nodes of an association belong, or None where that cannot be told."""
        if not self._reference.is_fitted or len(self._reference.moving) != len(features):
            return None
        moving = self._reference.moving.tolist()
        resting = moving.index(False)
        if features[resting] not in self._maps:
            self._maps[features[resting]] = self._map(resting, features[resting])
        matrix = self._maps[features[resting]]
        if matrix is None:
            return None
        places: list[tuple[float, ...] | None] = [None] * len(nodes)
        for node in range(len(nodes)):
            if moving[node]:
                end = self._end(node, features)
                if end is None:
                    return None
                place = mapped(matrix, end[None])
                if not self._is_near(node, place, nodes[resting]):
                    return None
                places[node] = tuple(place[0].tolist())
        return tuple(places)

    def _is_near(self, node: int, place: Float64[np.ndarray, "1 g"], resting: Node) -> bool:
        """Return whether a goal is about as far from the resting node as it was in the demonstration."""
        if node not in self._usual_px:
            other = self._reference.moving.tolist().index(False)
            ends = [centers(_array(self._reference.node(own)[1])) for own in (node, other)]
            self._usual_px[node] = float(np.quantile(np.linalg.norm(ends[0] - ends[1], axis=1), 0.95))
        distance = float(np.linalg.norm(centers(place)[0] - resting.center))
        return distance <= MAX_STRETCH * self._usual_px[node] + TOLERANCE_PX

    def _map(self, node: int, feature: int) -> Float64[np.ndarray, "3 3"] | None:
        """Return the map from the demonstration's end to this frame, anchored at a resting node."""
        kind = self._member.kernel.roles[node]
        anchor = self._possible(kind)
        anchor = anchor.chosen(anchor.feature == feature)
        if len(anchor) == 0:
            return None
        if kind not in (NodeType.POINT, NodeType.LINE):  # of a plane or an ellipse, the center is its anchor
            anchor = Matches(NodeType.POINT, centers(anchor.source), centers(anchor.target), anchor.feature)
        if self._distinct:  # nodes of one thing have one map
            agree = residuals(np.stack(self._distinct), anchor).min(axis=1) <= TOLERANCE_PX
            if agree.any():
                return self._distinct[int(agree.argmax())]
        around = NodeType.POINT if NodeType.POINT in self._member.node_types else kind
        others = self._possible(around)
        if kind is around:
            others = others.chosen(others.feature != feature)
        else:  # every pair of points is tried, so the nearest have to do
            distance = np.linalg.norm(centers(others.source) - centers(anchor.source[:1]), axis=1)
            near = np.argsort(distance, kind="stable")[:40]
            others = others.chosen(near)
        found = anchored_map(anchor, others, TOLERANCE_PX)
        if found is None:
            found = self._shift(kind, feature, anchor)
        if found is not None:
            self._distinct.append(found)
        return found

    def _shift(self, kind: NodeType, feature: int, anchor: Matches) -> Float64[np.ndarray, "3 3"] | None:
        """Return the shift of the anchor alone, where it is a point that looks like one stored feature only."""
        if kind is NodeType.LINE:
            return None
        stored, ends = (_array(rows) for rows in self._reference.surroundings(kind))
        difference = np.linalg.norm(stored - self._descriptors[kind][feature], axis=1)
        best = int(difference.argmin())
        elsewhere = np.linalg.norm(centers(ends) - centers(ends[best : best + 1]), axis=1) > TOLERANCE_PX
        rival = float(difference[elsewhere].min(initial=np.inf))
        similar = self._reference.similar(kind)
        if difference[best] > SURE_SHARE * similar or rival < similar:
            return None
        shift = np.eye(3)
        shift[:2, 2] = anchor.target[0] - centers(ends[best : best + 1])[0]
        return shift

    def _possible(self, kind: NodeType) -> Matches:
        """Return the stored features around the target that present ones may be, the most similar ones of each."""
        if kind not in self._matches:
            stored, ends = (_array(rows) for rows in self._reference.surroundings(kind))
            difference = descriptor_differences(self._descriptors[kind], stored)
            best = _smallest(difference, MAX_CANDIDATES)
            row, column = np.nonzero(np.take_along_axis(difference, best, axis=1) <= self._reference.similar(kind))
            source, target = ends[best[row, column]], self._geometry[kind][row]
            self._matches[kind] = Matches(kind, source.astype(np.float64), target.astype(np.float64), row)
        return self._matches[kind]

    def _end(self, node: int, features: Sequence[int]) -> Float64[np.ndarray, " g"] | None:
        """Return where a moving node lay at the end of the demonstration; None where look-alikes lay elsewhere."""
        kind, feature = self._member.kernel.roles[node], features[node]
        similar, stored = self._reference.similar(kind), self._stored_ends(node)
        own = stored.difference[feature]
        candidates = own <= min(similar, float(own.min()) + LOOK_ALIKE_SHARE * similar)
        if (node, feature) not in self._ends:
            self._ends[node, feature] = _agreed(kind, stored.ends[candidates], own[candidates])
        end = self._ends[node, feature]
        if end is None:  # the partner tells look-alikes apart
            candidates = candidates[: stored.selected]
            for other, other_kind in enumerate(self._member.kernel.roles):
                if other != node:
                    difference = self._stored_ends(other).difference[features[other], : stored.selected]
                    candidates = candidates & (difference <= self._reference.similar(other_kind))
            rows = np.flatnonzero(candidates)
            end = _agreed(kind, stored.ends[rows], own[rows])
        return end

    def _stored_ends(self, node: int) -> "_StoredEnds":
        if node not in self._stored:
            kind = self._member.kernel.roles[node]
            descriptors, ends = zip(self._reference.node(node), self._reference.carried(kind), strict=True)
            known = np.concatenate([_array(rows).reshape(-1, self._descriptors[kind].shape[1]) for rows in descriptors])
            self._stored[node] = _StoredEnds(
                np.concatenate([_array(rows).reshape(-1, kind.geometry_dim) for rows in ends]),
                descriptor_differences(self._descriptors[kind], known),
                len(descriptors[0]),
            )
        return self._stored[node]


@final
@dataclass(frozen=True, eq=False)
class _StoredEnds:
    """Where the features that a node of the demonstration was, or may be, lay at its end.

    Attributes:
        ends: ``[r, g]``, those of the selected features first, in their order, then of others of the carried thing.
        difference: ``[n, r]`` of each descriptor of the frame from each of theirs.
        selected: number of the selected features.
    """

    ends: Float32[np.ndarray, "r g"]
    difference: Float32[np.ndarray, "n r"]
    selected: int


def _agreed(
    kind: NodeType, ends: Float32[np.ndarray, "c g"], difference: Float32[np.ndarray, " c"]
) -> Float64[np.ndarray, " g"] | None:
    """Return where most of the candidates lay at the end, or None where they lay at different places."""
    if len(ends) == 0:
        return None
    if kind is not NodeType.LINE:
        middles = centers(ends)
        near = np.linalg.norm(middles - np.median(middles, axis=0), axis=1) <= TOLERANCE_PX
        return np.asarray(ends[near].mean(axis=0), np.float64) if near.mean() >= MIN_AGREEMENT else None
    best: np.ndarray = ends[int(difference.argmin())].astype(np.float64)
    lines = Matches(kind, ends.astype(np.float64), np.tile(best, (len(ends), 1)), np.arange(len(ends)))
    same = residuals(np.eye(3)[None], lines)[0] <= TOLERANCE_PX
    return best if same.mean() >= MIN_AGREEMENT else None


def descriptor_differences(
    first: Float32[np.ndarray, "n d"], second: Float32[np.ndarray, "m d"]
) -> Float32[np.ndarray, "n m"]:
    """Return the distances between descriptors of unit norm, from 0 to 2."""
    return np.asarray(np.sqrt(np.maximum(0.0, 2.0 - 2.0 * first @ second.T)), np.float32)


def _smallest(values: Float32[np.ndarray, "n m"], count: int) -> Int64[np.ndarray, "n k"]:
    """Return the columns of the smallest values of each row, in their order; all columns where there are no more."""
    chosen = np.arange(values.shape[1])[None].repeat(len(values), axis=0)
    if values.shape[1] > count:  # there may be a thousand
        chosen = np.sort(np.argpartition(values, count - 1, axis=1)[:, :count], axis=1)
    order = np.argsort(np.take_along_axis(values, chosen, axis=1), axis=1, kind="stable")
    return np.asarray(np.take_along_axis(chosen, order, axis=1))


def goals_of(
    member: KernelModel, nodes: Sequence[Sequence[Node]], places: Sequence[Places], axis: Float[Tensor, "2"]
) -> list[Goal]:
    """Return what is left until the moving nodes of associations are where they belong.

    Args:
        member: gives the error and the tolerance.
        nodes: of each association, directed.
        places: of the moving nodes of each at the goal; the same nodes move in all of them.
        axis: by which segments are directed.
    """
    if not nodes:
        return []
    kernel, moving = member.kernel, [node for node, place in enumerate(places[0]) if place is not None]
    present = [torch.tensor([own[node].coordinates for own in nodes]) for node in range(len(kernel.roles))]
    at_goal = list(present)
    for node in moving:
        at_goal[node] = _as_long(kernel.roles[node], torch.tensor([own[node] for own in places]), present[node])
    at_goal = directed_nodes(kernel, at_goal, axis.to(present[0])[None])

    def difference(given: Sequence[Tensor]) -> Tensor:
        now, goals = list(given[: len(present)]), list(given[: len(present)])
        for node, rows in zip(moving, given[len(present) :], strict=True):
            goals[node] = rows
        return kernel.control_error(now) - kernel.control_error(goals)

    given = [*present, *(at_goal[node] for node in moving)]
    errors, stds = difference(given).tolist(), propagated_std(difference, given).tolist()
    tolerance = float(member.goal.tolerance)
    return [
        Goal(tuple(own), tuple(error), tuple(std), tolerance)
        for own, error, std in zip(places, errors, stds, strict=True)
    ]


def _as_long(node_type: NodeType, place: Float[Tensor, "m g"], present: Float[Tensor, "m g"]) -> Float[Tensor, "m g"]:
    """Return segments at their places, but as long as they are detected now, at the nearest position along their lines.

    Detectors end a segment elsewhere in every frame, which says nothing about the way that is left.
    """
    if node_type is not NodeType.LINE:
        return place
    start, along = place[:, :2], place[:, 2:] - place[:, :2]
    size = length(place)[:, None].clamp_min(DEGENERATE_LENGTH_PX)
    share = (((midpoint(present) - start) * along).sum(dim=1, keepdim=True) / size**2).clamp(0.0, 1.0)
    center, arm = start + share * along, along / size * length(present)[:, None] / 2
    return torch.cat([center - arm, center + arm], dim=1)


def _array(rows: Tensor) -> np.ndarray:
    array: np.ndarray = rows.numpy(force=True)
    return array
