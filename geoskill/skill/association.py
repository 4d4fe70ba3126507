"""Result of inference on one frame: the selected associations and their control errors."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, final

import numpy as np
from jaxtyping import Bool, Float32

from geoskill.features.feature_set import FeatureSet
from geoskill.geometry.primitives import NodeType, centers


@final
@dataclass(frozen=True)
class Node:
    """One feature of an association.

    Attributes:
        node_type: point or line.
        coordinates: x, y of a point or x1, y1, x2, y2 of a line, in pixels.
        feature: row in the feature set that the node was detected in, or None where it was not detected.

    Raises:
        ValueError: when the number of coordinates does not fit the node type.
    """

    node_type: NodeType
    coordinates: tuple[float, ...]
    feature: int | None = None

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
        if self.node_type is NodeType.LINE:
            x1, y1, x2, y2 = xy
            return {"type": str(self.node_type), "xy": [[x1, y1], [x2, y2]]}
        return {"type": str(self.node_type), "xy": xy}


Track = Callable[[NodeType, Float32[np.ndarray, "n g"]], tuple[Float32[np.ndarray, "n g"], Bool[np.ndarray, " n"]]]
"""Function from features of one type to their positions in another frame, and whether each could be tracked."""


def track_nodes(nodes: Sequence[Node], track: Track) -> tuple[Node, ...] | None:
    """Return the nodes at their positions in another frame, or None when one of them could not be tracked.

    The returned nodes have no ``feature``, since they were not detected there. The position of a line along itself is
    uncertain (:func:`geoskill.tracking.flow.track_dense`).
    """
    tracked_nodes = list(nodes)
    for node_type in dict.fromkeys(node.node_type for node in nodes):
        indices = [index for index, node in enumerate(nodes) if node.node_type is node_type]
        geometry = np.array([nodes[index].coordinates for index in indices], np.float32)
        geometry, tracked = track(node_type, geometry)
        if not tracked.all():
            return None
        for index, row in zip(indices, geometry.tolist(), strict=True):
            tracked_nodes[index] = Node(node_type, tuple(row))
    return tuple(tracked_nodes)


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
        nodes: the features it joins.
        error: control error of the kernel (see the kernel for sign and dimension).
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

    def as_json(self) -> dict[str, Any]:
        """Return the association as written to ``associations.jsonl``, without the frame's number and time."""
        return {
            "kernel": self.kernel,
            "descriptor": self.descriptor,
            "rank": self.rank,
            "confidence": round(self.confidence, 6),
            "weight": round(self.weight, 6),
            "nodes": [node.as_json() for node in self.nodes],
            "error": [round(component, 4) for component in self.error],
        }


@final
@dataclass(frozen=True, eq=False)
class InferenceResult:
    """Selected associations of one frame.

    Attributes:
        associations: the best associations of every ensemble member, in the order of the members, then by rank; the
            first one is the first member's top association.
        features: detected features, by the extractor's name.
        reasons: why a member selects nothing, by the member's name; members that select something have no entry.
    """

    associations: tuple[Association, ...]
    features: Mapping[str, FeatureSet] = field(default_factory=dict)
    reasons: Mapping[str, str] = field(default_factory=dict)

    @property
    def error(self) -> np.ndarray:
        """``[d]``, float64, the control errors of the members' top associations, concatenated.

        Members that select nothing contribute nothing.
        """
        top_errors = (association.error for association in self.associations if association.rank == 1)
        return np.concatenate([np.zeros(0), *top_errors])


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
    )
