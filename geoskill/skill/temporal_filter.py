"""A skill that does not change its mind without need: selection over time.

Each frame by itself, the best of several good associations is now this one and now that one, and the control error
jumps with it. Here the selected association stays as long as its features are there, and another has to be better for a
while before it takes its place::

    lead_t = max(0, lead_{t-1} + (b_best - b_kept) / spread - margin)        spread: the SD of all scores of the frame

and the kept one goes when the lead exceeds the patience, when optical flow loses one of its features, when one that is
not detected looks otherwise than it did (something has come before it), or has not been detected for too long. An
association whose nodes have lately moved as one falls behind (:mod:`geoskill.tracking.co_motion`). Beside that, only the
few selected features are followed, and only to know them again: which association is right is still what the network
says of the descriptors.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import final

import cv2
import numpy as np
import torch
from jaxtyping import Bool, UInt8
from torch import Tensor

from geoskill.features.feature_set import FeatureSet
from geoskill.kernels.kernel import Kernel
from geoskill.skill.association import Association, InferenceResult, Node, follow_nodes
from geoskill.skill.matching import is_same_feature
from geoskill.skill.scored_frame import ScoredInstances
from geoskill.skill.skill import Skill
from geoskill.tracking.appearance import matches, patches_at
from geoskill.tracking.co_motion import CoMotionDetector
from geoskill.tracking.flow import track_sparse

# In standard deviations of a frame's scores: what another association may be ahead without gaining on the kept one, and
# the sum over frames of what it is ahead beyond that. Measured on simulated sorting, seeds 4 and 5 (object outside FOV,
# occlusion): 0.32 and 0.51 switches per frame become 0.07 and 0.13, and accuracy goes from 95.9 and 93.9 to 92.5 and
# 94.1. With 0.5 and 0.5 it is 0.08 and 0.15, 93.1 and 92.9. What is wrong stays as long as the patience, too.
MARGIN = 0.3
PATIENCE = 2.0
# Frames for which a feature may go undetected while flow still follows it, a tenth of a second of video. With ten it is
# 0.06 and 0.11, 89.1 and 93.6: what is wrong is not often found again.
LONGEST_MISS = 3
# By how many standard deviations of a frame's scores an association of nodes that moved as one falls behind. The scores
# of look-alikes are less than one apart; the best is 3 to 6 ahead of the mean, and stays so where nothing is like it.
CO_MOTION_PENALTY = 2.0


@final
@dataclass(frozen=True)
class _Selected:
    """The association that is being kept.

    Attributes:
        association: as of the last frame.
        lead: how far another is ahead, in standard deviations times frames, beyond the margin.
        missed: for how many frames one of its features has not been detected.
        looks: what its nodes looked like when all of them were.
    """

    association: Association
    looks: tuple[np.ndarray, ...]
    lead: float = 0.0
    missed: int = 0


@final
class TemporalFilter:
    """A skill and what it selected in the frame before.

    Args:
        skill: gives every instance its score.
    """

    def __init__(self, skill: Skill) -> None:
        self.skill = skill
        self._kept: dict[str, _Selected] = {}
        self._before: UInt8[np.ndarray, "height width"] | None = None
        self._motion = CoMotionDetector()

    def infer(
        self, frame: UInt8[np.ndarray, "height width 3"], features: Mapping[str, FeatureSet] | None = None
    ) -> InferenceResult:
        """The associations of the next RGB frame: of each member first the kept one, then the best of the others.

        A kept association with a feature that was not detected has the confidence of the last frame in which all were,
        and its nodes lie where the flow leads; such a node has no ``feature``.

        Args:
            frame: the picture.
            features: what :meth:`Skill.extract` found in it, when that has been done.

        Raises:
            InputError: when the frame is not ``[H, W, 3]`` of uint8, or has no pixel.
        """
        observation = self.skill.observe(frame, features)
        gray = np.asarray(cv2.cvtColor(frame, cv2.COLOR_RGB2GRAY), np.uint8)
        if self._before is not None and self._before.shape != gray.shape:
            self._kept = {}
        selected: dict[str, list[Association]] = {}
        self._motion.advance(gray)
        for name, scored in observation.members.items():
            spread = scored.spread
            scored = scored.penalized(self._moved_as_one(scored), CO_MOTION_PENALTY * spread)
            kept = self._still_kept(self._kept.pop(name, None), scored, spread, gray)
            best = scored.associations(scored.best(self.skill.alternatives))
            if kept is None and best:
                kept = _Selected(best[0], _looks(best[0].nodes, gray))
            if kept is not None and best:
                self._kept[name] = kept
                best = _with_first(kept.association, best)
            selected[name] = best
        self._before = gray
        return observation.result(selected)

    def _moved_as_one(self, scored: ScoredInstances) -> Bool[Tensor, " m"]:
        member, graph = scored.member, scored.graph
        geometry = {kind: rows.numpy(force=True) for kind, rows in member.attribute(graph, "geometry").items()}
        as_one = self._motion.co_moving(member.kernel, geometry, graph.instance_index.numpy(force=True))
        return torch.from_numpy(as_one).to(scored.scores.device)

    def _still_kept(
        self, kept: _Selected | None, scored: ScoredInstances, spread: float, gray: UInt8[np.ndarray, "height width"]
    ) -> _Selected | None:
        """The kept association in the next frame, or None when it goes."""
        if kept is None or self._before is None or len(scored) == 0:
            return None
        nodes = follow_nodes(kept.association.nodes, partial(track_sparse, start=self._before, end=gray))
        if nodes is None:
            return None
        instance = _find(scored, nodes)
        if instance is None:
            hidden = any(not matches(*pair) for pair in zip(kept.looks, _looks(nodes, gray), strict=True))
            if hidden or kept.missed == LONGEST_MISS:
                return None
            association = replace(kept.association, nodes=nodes, error=_error(scored.member.kernel, nodes))
            return replace(kept, association=association, missed=kept.missed + 1)
        ahead = float(scored.scores.max() - scored.scores[instance])
        lead = max(0.0, kept.lead + (ahead / spread if spread > 0 else 0.0) - MARGIN)
        association = scored.associations([instance])[0]
        return _Selected(association, _looks(association.nodes, gray), lead) if lead <= PATIENCE else None


def _looks(nodes: Sequence[Node], gray: UInt8[np.ndarray, "height width"]) -> tuple[np.ndarray, ...]:
    """The patches of each node (:func:`patches_at`)."""
    return tuple(patches_at(gray, node.node_type, node.coordinates) for node in nodes)


def _find(scored: ScoredInstances, nodes: Sequence[Node]) -> int | None:
    """The instance of the detected features that the nodes are, or None when one of them was not detected."""
    geometry = scored.member.attribute(scored.graph, "geometry")
    features = []
    for node in nodes:
        detected = [Node(node.node_type, tuple(row)) for row in geometry[node.node_type].tolist()]
        same = [row for row, other in enumerate(detected) if is_same_feature(node, other)]
        if not same:
            return None
        features.append(min(same, key=lambda row: _distance(node, detected[row])))
    return scored.find(features)


def _distance(one: Node, other: Node) -> float:
    return float(np.linalg.norm(np.subtract(one.center, other.center)))


def _error(kernel: Kernel, nodes: Sequence[Node]) -> tuple[float, ...]:
    error = kernel.control_error([torch.tensor([node.coordinates]) for node in nodes])
    return tuple(error[0].tolist())


def _with_first(kept: Association, best: Sequence[Association]) -> list[Association]:
    """The kept association, then the best of the others, ranked anew, as many as there were."""

    def joined(association: Association) -> frozenset[tuple[str, int | None]]:
        return frozenset((node.node_type, node.feature) for node in association.nodes)

    others = [association for association in best if joined(association) != joined(kept)]
    return [replace(each, rank=place) for place, each in enumerate([kept, *others][: len(best)], start=1)]
