"""What a skill says about one frame: the associations it selected and their control errors."""

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
        node_type: what it is.
        coordinates: x, y of a point or x1, y1, x2, y2 of a line, in pixels.
        feature: its row in the feature set it comes from, or None where that is not known.
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
        """The point itself, or the midpoint of the segment."""
        xy = centers(np.array([self.coordinates], np.float64))[0]
        return float(xy[0]), float(xy[1])

    def as_json(self) -> dict[str, Any]:
        """The node as it stands in ``associations.jsonl``."""
        xy = [round(coordinate, 3) for coordinate in self.coordinates]
        if self.node_type is NodeType.LINE:
            x1, y1, x2, y2 = xy
            return {"type": str(self.node_type), "xy": [[x1, y1], [x2, y2]]}
        return {"type": str(self.node_type), "xy": xy}


Follow = Callable[[NodeType, Float32[np.ndarray, "n g"]], tuple[Float32[np.ndarray, "n g"], Bool[np.ndarray, " n"]]]
"""Where features of a type lie in another frame, and which of them could be followed."""


def follow_nodes(nodes: Sequence[Node], follow: Follow) -> tuple[Node, ...] | None:
    """Nodes where they lie in another frame, or None when one of them could not be followed there.

    They are no detected features there. A line's place along itself is uncertain
    (:func:`geoskill.tracking.flow.track_dense`).
    """
    moved = list(nodes)
    for node_type in dict.fromkeys(node.node_type for node in nodes):
        places = [place for place, node in enumerate(nodes) if node.node_type is node_type]
        geometry = np.array([nodes[place].coordinates for place in places], np.float32)
        geometry, followed = follow(node_type, geometry)
        if not followed.all():
            return None
        for place, row in zip(places, geometry.tolist(), strict=True):
            moved[place] = Node(node_type, tuple(row))
    return tuple(moved)


@final
@dataclass(frozen=True)
class Association:
    """One selected instance of a kernel.

    Attributes:
        kernel: the kernel's name, such as ``p2p``.
        descriptor: the extractors of its nodes, such as ``sift`` or ``sift+lbd``.
        rank: 1 for the instance with the largest select-out of its kernel, or for the one that is kept from the frame
            before (:class:`geoskill.skill.temporal_filter.TemporalFilter`).
        confidence: the probability that it is right, in [0, 1] (:mod:`geoskill.model.confidence`).
        weight: the select-out g, its share of the frame's selection; of all instances of a kernel they sum to 1.
        nodes: the features it joins.
        error: the kernel's control error (see the kernel for sign and dimension).
        unit: of the error, as it is printed.
    """

    kernel: str
    descriptor: str
    rank: int
    confidence: float
    weight: float
    nodes: tuple[Node, ...]
    error: tuple[float, ...]
    unit: str = "px"

    @property
    def member(self) -> tuple[str, str]:
        """Which member of the ensemble selected it: kernel and descriptor."""
        return self.kernel, self.descriptor

    def as_json(self) -> dict[str, Any]:
        """The part of its line in ``associations.jsonl`` that does not depend on the frame."""
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
    """The selected associations of one frame.

    Attributes:
        associations: the best of every ensemble member, in the order of the members, then by rank; the first one is
            the first member's top association.
        features: what each extractor found, by the extractor's name.
        reasons: for each (kernel, descriptor) that selects nothing, why.
    """

    associations: tuple[Association, ...]
    features: Mapping[str, FeatureSet] = field(default_factory=dict)
    reasons: Mapping[tuple[str, str], str] = field(default_factory=dict)

    @property
    def error(self) -> np.ndarray:
        """``[d]``, the control errors of the members' top associations one after another, float64.

        Members that select nothing contribute nothing.
        """
        return np.concatenate([np.zeros(0), *(each.error for each in self.associations if each.rank == 1)])


def abstain_below(result: InferenceResult, least: float) -> InferenceResult:
    """What is selected of a frame when a member says nothing rather than what it is not sure of.

    Args:
        result: of the frame.
        least: the confidence that a member's top association must have for the member to select any.
    """
    doubtful = {each.member: each.confidence for each in result.associations if each.rank == 1}
    doubtful = {member: confidence for member, confidence in doubtful.items() if confidence < least}
    if not doubtful:
        return result
    kept = tuple(each for each in result.associations if each.member not in doubtful)
    reasons = {
        member: f"no association visible: the selected one has a confidence of {confidence:.2g}, less than {least:g}"
        for member, confidence in doubtful.items()
    }
    return replace(result, associations=kept, reasons={**result.reasons, **reasons})
