"""How the target moved since the end of the demonstration, in space, as seen from a resting feature of it.

Its features of that time, matched by their descriptors, tell it: points (:mod:`geoskill.geometry.rigid_map`), or lines
where a member has no points (:mod:`geoskill.geometry.line_motion`). Only a motion that takes the resting feature itself
onto its counterpart counts, since a background may have moved otherwise.
"""

from typing import Final, NamedTuple, final

import numpy as np
from jaxtyping import Float32, Float64, Int64

from geoskill.geometry.line_motion import anchored_line_motion, lines_agree
from geoskill.geometry.primitives import NodeType
from geoskill.geometry.rigid_map import anchored_motion
from geoskill.geometry.space_places import distances_in_space, moved_place
from geoskill.graphs.motif_graph import MotifGraph
from geoskill.model.kernel_model import KernelModel
from geoskill.skill.goal import MAX_CANDIDATES, descriptor_differences

TOLERANCE_M: Final = 0.008
"""Distance at which two places of one feature agree: three standard deviations of two depths at 0.7 m from a D435."""
MAX_ANCHORS: Final = 12
"""Points around a resting line through which a motion is looked for."""

Motion = Float64[np.ndarray, "4 4"]


@final
class _Matches(NamedTuple):
    """Possible matches of present features with stored ones, those of stored features near the target first.

    Attributes:
        source: places at the demonstration's end.
        target: present places.
        feature: number of the present feature.
    """

    source: Float64[np.ndarray, "c s"]
    target: Float64[np.ndarray, "c s"]
    feature: Int64[np.ndarray, " c"]


@final
class TargetMotions:
    """Motions of the targets of one member in one frame.

    Args:
        member: with its goal reference.
        graph: of the frame.
    """

    def __init__(self, member: KernelModel, graph: MotifGraph) -> None:
        self._reference = member.goal
        self._around = NodeType.POINT if NodeType.POINT in member.node_types else NodeType.LINE
        self._descriptors: dict[NodeType, Float32[np.ndarray, "n d"]] = {
            kind: rows.numpy(force=True) for kind, rows in member.attribute(graph, "descriptor").items()
        }
        self._space = {
            kind: rows.numpy(force=True).astype(np.float64) for kind, rows in member.attribute(graph, "space").items()
        }
        self._found: dict[tuple[NodeType, int], Motion | None] = {}
        self._matches: dict[NodeType, _Matches] = {}

    def descriptor(self, kind: NodeType, feature: int) -> Float32[np.ndarray, "1 d"]:
        """Return the descriptor of a feature of the frame."""
        return self._descriptors[kind][[feature]]

    def of(self, kind: NodeType, feature: int) -> Motion | None:
        """Return the motion of the target that a point or a line of the frame is on, or None where it is not known."""
        if (kind, feature) not in self._found:
            self._found[kind, feature] = self._motion(kind, feature)
        return self._found[kind, feature]

    def _motion(self, kind: NodeType, feature: int) -> Motion | None:
        around, own = self._possible(self._around), self._possible(kind)
        counterparts, place = own.source[own.feature == feature], self._space[kind][feature]
        if not np.isfinite(place).all():
            return None
        for motion in self._found.values():  # features of one thing have one motion
            if motion is not None and any(self._fits(kind, counterpart, place, motion) for counterpart in counterparts):
                return motion
        if kind is not self._around:
            return self._through_points_near(kind, counterparts, place)
        others = around.feature != feature
        search = anchored_motion if kind is NodeType.POINT else anchored_line_motion
        rows = around.source[others], around.target[others], around.feature[others]
        for counterpart in counterparts:
            motion = search((counterpart, place), *rows, TOLERANCE_M)
            if motion is not None:
                return motion
        return None

    def _through_points_near(
        self, kind: NodeType, counterparts: Float64[np.ndarray, "c s"], place: Float64[np.ndarray, " s"]
    ) -> Motion | None:
        """Return the motion of points near a line that takes it onto its counterpart."""
        points = self._possible(NodeType.POINT)
        for counterpart in counterparts:
            middle = counterpart.reshape(-1, 3).mean(axis=0)
            nearest = np.argsort(np.linalg.norm(points.source - middle, axis=1), kind="stable")[:MAX_ANCHORS]
            for row in nearest:
                others = points.feature != points.feature[row]
                motion = anchored_motion(
                    (points.source[row], points.target[row]),
                    points.source[others],
                    points.target[others],
                    points.feature[others],
                    TOLERANCE_M,
                )
                if motion is not None and self._fits(kind, counterpart, place, motion):
                    return motion
        return None

    @staticmethod
    def _fits(
        kind: NodeType, counterpart: Float64[np.ndarray, " s"], place: Float64[np.ndarray, " s"], motion: Motion
    ) -> bool:
        """Return whether a motion takes a stored feature onto a present one."""
        if kind is NodeType.LINE:
            return bool(lines_agree(counterpart[None], place[None], motion, TOLERANCE_M)[0])
        return float(distances_in_space(kind, moved_place(kind, counterpart, motion)[None], place)[0]) <= TOLERANCE_M

    def _possible(self, kind: NodeType) -> _Matches:
        """Return the stored features around the target that present ones may be, the most similar ones of each."""
        if kind in self._matches:
            return self._matches[kind]
        stored, ends = (rows.numpy(force=True) for rows in self._reference.surroundings(kind))
        known = np.flatnonzero(np.isfinite(self._space[kind]).all(axis=1))
        if len(stored) == 0 or len(known) == 0:
            width = kind.space_dim
            nothing = _Matches(np.zeros((0, width)), np.zeros((0, width)), np.zeros(0, np.int64))
            return self._matches.setdefault(kind, nothing)
        difference = descriptor_differences(self._descriptors[kind][known], stored)
        nearest = np.argsort(difference, axis=1, kind="stable")[:, :MAX_CANDIDATES]
        similar = np.take_along_axis(difference, nearest, axis=1) <= self._reference.similar(kind)
        row, column = np.nonzero(similar)
        source = ends[nearest[row, column]].astype(np.float64)
        return self._matches.setdefault(kind, _Matches(source, self._space[kind][known[row]], known[row]))
