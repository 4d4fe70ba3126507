"""Result of inference on one frame: the selected associations and their control errors."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from enum import StrEnum
from typing import Any, final

import numpy as np
from jaxtyping import Bool, Float, Float32

from geoskill.features.feature_set import FeatureSet
from geoskill.geometry.primitives import NodeType, centers
from geoskill.skill.member_status import MemberStatus, State


@final
class NodeRole(StrEnum):
    """What a node does in the task; the values are the names used in files."""

    MOVING = "moving"
    RESTING = "resting"


@final
@dataclass(frozen=True)
class Node:
    """One feature of an association.

    Attributes:
        node_type: type of the feature.
        coordinates: x, y of a point, x1, y1, x2, y2 of a line, and likewise of others, in pixels. The end points of a
            line are in the order by which the sign of the error is decided
            (:func:`geoskill.kernels.kernel.directed_nodes`).
        feature: row in the feature set that the node was detected in, or None where it was not detected.
        role: whether it moves or rests in the task, as learned from the demonstration; None where that is not known.
        space: where it is in space, in meters (:mod:`geoskill.geometry.primitives`); None where that is not asked for.
        space_covariance: of ``space``, row by row.

    Raises:
        ValueError: when the number of coordinates does not fit the node type.
    """

    node_type: NodeType
    coordinates: tuple[float, ...]
    feature: int | None = None
    role: NodeRole | None = None
    space: tuple[float, ...] | None = None
    space_covariance: tuple[tuple[float, ...], ...] | None = None

    def __post_init__(self) -> None:
        expected = self.node_type.geometry_dim
        if len(self.coordinates) != expected:
            raise ValueError(f"a {self.node_type} has {len(self.coordinates)} coordinates; expected {expected}")

    @property
    def center(self) -> tuple[float, float]:
        """The point itself, or the midpoint of the segment, in pixels."""
        xy = centers(np.array([self.coordinates], np.float64))[0]
        return float(xy[0]), float(xy[1])

    def as_json(self) -> dict[str, Any]:
        """Return the node as written to ``associations.jsonl``."""
        xy = [round(coordinate, 3) for coordinate in self.coordinates]
        more: dict[str, Any] = {} if self.role is None else {"role": str(self.role)}
        if self.space is not None:
            key = "plane" if self.node_type is NodeType.PLANE else "xyz_m"
            more[key] = _in_points([round(value, 5) for value in self.space], 4 if key == "plane" else 3)
        return {"type": str(self.node_type), "xy": _in_points(xy, 2), **more}


def _in_points(values: Sequence[float], width: int) -> list[Any]:
    """Return numbers as points of a width; those of a single one as they are."""
    points = [list(values[start : start + width]) for start in range(0, len(values), width)]
    return points[0] if len(points) == 1 else points


Track = Callable[[NodeType, Float32[np.ndarray, "n g"]], tuple[Float32[np.ndarray, "n g"], Bool[np.ndarray, " n"]]]
"""Function from features of one type to their positions in another frame, and whether each could be tracked."""


def track_nodes(nodes: Sequence[Node], track: Track) -> tuple[Node, ...] | None:
    """Return the nodes at their positions in another frame, or None when one of them could not be tracked.

    The returned nodes have no ``feature`` and no ``space``, since they were not detected there. The position of a line
    along itself is uncertain (:func:`geoskill.tracking.flow.track_dense`).
    """
    tracked_nodes = list(nodes)
    for node_type in dict.fromkeys(node.node_type for node in nodes):
        indices = [index for index, node in enumerate(nodes) if node.node_type is node_type]
        geometry = np.array([nodes[index].coordinates for index in indices], np.float32)
        geometry, tracked = track(node_type, geometry)
        if not tracked.all():
            return None
        for index, row in zip(indices, geometry.tolist(), strict=True):
            tracked_nodes[index] = Node(node_type, tuple(row), role=nodes[index].role)
    return tuple(tracked_nodes)


@final
@dataclass(frozen=True)
class Goal:
    """What is left until an association is as it was at the end of the demonstration.

    Attributes:
        nodes: geometry of each moving node at the goal, in pixels of this frame; None for a resting node.
        error: goal error, in the unit of the kernel's error.
        std: standard deviation of each component, from noise of detection of all nodes.
        tolerance: norm of the goal error up to which an association is at its goal, as learned from the demonstration.
        space: place of each moving node at the goal in meters, None for a resting node; empty for a kernel that is not
            in space, for which nodes may be None that are not shown.
    """

    nodes: tuple[tuple[float, ...] | None, ...]
    error: tuple[float, ...]
    std: tuple[float, ...]
    tolerance: float = 0.0
    space: tuple[tuple[float, ...] | None, ...] = ()


@final
@dataclass(frozen=True)
class Association:
    """One selected instance of a kernel.

    Attributes:
        member: name of the ensemble member that selected it, such as ``p2p_sift`` or ``p2l_sift_lbd``.
        kernel: name of the kernel, such as ``p2p``.
        descriptor: extractors of its nodes, such as ``sift`` or ``sift+lbd``.
        rank: 1 for the instance with the largest select-out of its member, or for the one kept from the previous frame
            (:class:`geoskill.skill.temporal_filter.TemporalFilter`).
        confidence: probability that it is right, in [0, 1] (:mod:`geoskill.model.confidence`).
        weight: select-out g, in [0, 1]; those of all instances of a member in a frame sum to 1.
        nodes: the features it joins, the moving one first.
        error: control error of the kernel (see the kernel for sign and dimension), in the frame of the picture: x to
            the right, y down; moving minus resting.
        goal: what is left until it is as it was at the end of the demonstration; None where that cannot be told
            (:mod:`geoskill.skill.goal`).
        error_std: standard deviation of each component, from noise of detection
            (:data:`geoskill.geometry.uncertainty.DETECTION_STD_PX`) and of depth.
        unit: unit of the error, as printed.
    """

    member: str
    kernel: str
    descriptor: str
    rank: int
    confidence: float
    weight: float
    nodes: tuple[Node, ...]
    error: tuple[float, ...]
    unit: str = "px"
    error_std: tuple[float, ...] = ()
    goal: Goal | None = None

    @property
    def is_at_goal(self) -> bool:
        """Whether its goal error is known and within the tolerance."""
        return self.goal is not None and math.hypot(*self.goal.error) <= self.goal.tolerance

    def as_json(self) -> dict[str, Any]:
        """Return the association as written to ``associations.jsonl``, without the frame's number and time."""
        return {
            "kernel": self.kernel,
            "descriptor": self.descriptor,
            "rank": self.rank,
            "confidence": round(self.confidence, 6),
            "weight": round(self.weight, 6),
            "nodes": [node.as_json() for node in self.nodes],
            "error": self._rounded(self.error),
            "error_std": self._rounded(self.error_std),
            "unit": self.unit,
            "goal_error": None if self.goal is None else self._rounded(self.goal.error),
            "goal_error_std": None if self.goal is None else self._rounded(self.goal.std),
        }

    def _rounded(self, values: Sequence[float]) -> list[float]:
        return [round(value, 6 if self.unit == "m" else 4) for value in values]


@final
@dataclass(frozen=True, eq=False)
class InferenceResult:
    """Selected associations of one frame.

    Attributes:
        associations: the best associations of every ensemble member, in the order of the members, then by rank; the
            first one is the first member's top association.
        features: detected features, by the extractor's name.
        reasons: why a member selects nothing, by the member's name; members that select something have no entry.
        members: of every member, whether it selects something or not, by name: rows of its error, and state.
    """

    associations: tuple[Association, ...]
    features: Mapping[str, FeatureSet] = field(default_factory=dict)
    reasons: Mapping[str, str] = field(default_factory=dict)
    members: Mapping[str, MemberStatus] = field(default_factory=dict)

    @property
    def error(self) -> Float[np.ndarray, " d"]:
        """The control errors of the members' top associations, one after another: the same rows in every frame.

        NaN where a row is not available: its member is lost or unsure.
        """
        return self._rows(lambda top: top.error, lambda status: status.error_is_certain)

    @property
    def error_available(self) -> Bool[np.ndarray, " d"]:
        """Which rows of :attr:`error` are available."""
        available: Bool[np.ndarray, " d"] = np.isfinite(self.error)
        return available

    @property
    def error_std(self) -> Float[np.ndarray, " d"]:
        """Standard deviation of each row of :attr:`error`, from noise of detection; NaN where it is not available."""
        return self._rows(lambda top: top.error_std, lambda status: status.error_is_certain)

    @property
    def goal_error(self) -> Float[np.ndarray, " d"]:
        """What is left until the top associations are as they were at the end of the demonstration, in the same rows.

        NaN where that cannot be told (:mod:`geoskill.skill.goal`), or is not sure.
        """
        return self._rows(lambda top: top.goal and top.goal.error, lambda status: status.goal_error_is_certain)

    @property
    def goal_error_available(self) -> Bool[np.ndarray, " d"]:
        """Which rows of :attr:`goal_error` are available."""
        available: Bool[np.ndarray, " d"] = np.isfinite(self.goal_error)
        return available

    @property
    def goal_error_std(self) -> Float[np.ndarray, " d"]:
        """Standard deviation of each row of :attr:`goal_error`; NaN where it is not available."""
        return self._rows(lambda top: top.goal and top.goal.std, lambda status: status.goal_error_is_certain)

    @property
    def error_names(self) -> tuple[str, ...]:
        """Name of each row of :attr:`error`, such as ``p2p_sift.x``."""
        return tuple(row for status in self.members.values() for row in status.rows)

    @property
    def error_units(self) -> tuple[str, ...]:
        """Unit of each row of :attr:`error`; empty for errors without unit."""
        return tuple(status.unit for status in self.members.values() for _ in status.rows)

    @property
    def states(self) -> dict[str, State]:
        """State of each member."""
        return {name: status.state for name, status in self.members.items()}

    def rows_of(self, member: str) -> slice:
        """Return the rows of a member in :attr:`error` and the like.

        Raises:
            KeyError: when there is no such member.
        """
        start = 0
        for name, status in self.members.items():
            if name == member:
                return slice(start, start + len(status.rows))
            start += len(status.rows)
        raise KeyError(member)

    def _rows(
        self,
        values: Callable[[Association], Sequence[float] | None],
        is_certain: Callable[[MemberStatus], bool],
    ) -> Float[np.ndarray, " d"]:
        """Return the values of the top associations in the rows of their members, NaN where there are none."""
        top = {association.member: association for association in self.associations if association.rank == 1}
        rows = [np.zeros(0)]
        for name, status in self.members.items():
            own = values(top[name]) if name in top and is_certain(status) else None
            rows.append(np.asarray(own or np.full(len(status.rows), np.nan), np.float64))
        return np.concatenate(rows)


def abstain_below(result: InferenceResult, min_confidence: float) -> InferenceResult:
    """Return the result without the associations of members whose top association is not confident enough.

    Args:
        result: result of one frame.
        min_confidence: smallest confidence of a member's top association, in [0, 1], with which the member selects any.
    """
    confidences = {
        association.member: association.confidence for association in result.associations if association.rank == 1
    }
    # Written so that a confidence that is no number is doubtful.
    doubtful = {member: confidence for member, confidence in confidences.items() if not confidence >= min_confidence}
    if not doubtful:
        return result
    reasons = {
        member: "no association visible: the selected one has a confidence of"
        f" {confidence:.2g}, less than {min_confidence:g}"
        for member, confidence in doubtful.items()
    }
    return replace(
        result,
        associations=tuple(association for association in result.associations if association.member not in doubtful),
        reasons={**result.reasons, **reasons},
        members={
            name: MemberStatus(status.rows, status.unit) if name in doubtful else status
            for name, status in result.members.items()
        },
    )
