"""Selection over time: keep the selected association until it is lost or clearly beaten.

Selecting the best association of each frame on its own alternates between several good ones, and the control error
jumps at every switch. :class:`TemporalFilter` keeps the selected association and replaces it only after another one has
scored higher for some time (a one-sided cumulative sum)::

    margin_t = (b_best - b_selected) / (standard deviation of the frame's scores)
    excess_t = max(0, excess_{t-1} + margin_t - tolerated_margin)

The selected association is dropped when

- its excess is larger than the ``patience``,
- optical flow loses one of its nodes,
- not all of its nodes are detected and one of them looks different from before, since something occludes it, or
- not all of its nodes have been detected for more than ``max_missed_frames`` frames.

Associations whose nodes have recently moved together are penalized (:mod:`geoskill.tracking.co_motion`). Apart from
that, tracking serves only to recognize the few selected features in the next frame: the scores come from the
descriptors alone.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import final

import cv2
import numpy as np
import torch
from jaxtyping import Bool, Float, UInt8
from torch import Tensor

from geoskill.features.feature_set import FeatureSet
from geoskill.geometry.depth_picture import DepthPicture
from geoskill.geometry.segments import turned
from geoskill.kernels.kernel import reference_line
from geoskill.model.kernel_model import KernelModel
from geoskill.skill.association import Association, InferenceResult, Node, track_nodes
from geoskill.skill.goal import goals_of
from geoskill.skill.goal_in_space import moved_goal
from geoskill.skill.matching import find_feature
from geoskill.skill.node_errors import error_of_nodes, lifted_nodes
from geoskill.skill.scored_frame import ScoredInstances
from geoskill.skill.skill import Skill
from geoskill.skill.status_over_time import StatusOverTime
from geoskill.tracking.appearance import matches, patches_at
from geoskill.tracking.co_motion import CoMotionDetector
from geoskill.tracking.flow import track_sparse
from geoskill.tuning import TemporalFilterConfig


@final
@dataclass(frozen=True)
class _Selected:
    """The selected association of one member.

    Attributes:
        association: as of the last frame.
        appearance: patches of each node (:func:`patches_at`), as of the last frame in which all nodes were detected.
        excess: sum over frames of the best score's margin beyond the tolerated one, in standard deviations.
        missed: consecutive frames up to the last one in which not all nodes were detected.
    """

    association: Association
    appearance: tuple[np.ndarray, ...]
    excess: float = 0.0
    missed: int = 0


@final
class TemporalFilter:
    """Stateful selection on the consecutive frames of one video.

    Args:
        skill: gives the score of every instance.
        config: margins, penalty and patience; None for the defaults.
    """

    def __init__(self, skill: Skill, config: TemporalFilterConfig | None = None) -> None:
        self.skill = skill
        self._config = TemporalFilterConfig() if config is None else config
        self._selected: dict[str, _Selected] = {}
        self._axes: dict[str, Tensor] = {}
        self._statuses: dict[str, StatusOverTime] = {}
        self._previous_gray: UInt8[np.ndarray, "height width"] | None = None
        self._co_motion = CoMotionDetector(self._config.co_motion)

    def infer(
        self,
        frame: UInt8[np.ndarray, "height width 3"],
        features: Mapping[str, FeatureSet] | None = None,
        depth: DepthPicture | None = None,
    ) -> InferenceResult:
        """Select associations in the next RGB frame: of each member the kept one first, then the best of the others.

        A kept association with an undetected node has the confidence of the last frame in which all of its nodes were
        detected, and its nodes are where optical flow tracked them, without a ``feature``. A frame of another size
        starts anew.

        Args:
            frame: RGB image.
            features: result of :meth:`Skill.extract` on the frame, where it is already known.
            depth: of the picture, which members in space need.

        Raises:
            InputError: as :meth:`Skill.infer`.
        """
        scored_frame = self.skill.observe(frame, features, depth)
        gray = np.asarray(cv2.cvtColor(frame, cv2.COLOR_RGB2GRAY), np.uint8)
        if self._previous_gray is not None and self._previous_gray.shape != gray.shape:
            self._selected, self._axes, self._statuses = {}, {}, {}
        listed: dict[str, list[Association]] = {}
        statuses = {}
        self._co_motion.advance(gray)
        for name, scored in scored_frame.members.items():
            score_std = scored.score_std
            scored = scored.penalized(self._co_moving(scored), self._config.co_motion_penalty * score_std)
            last = self._selected.pop(name, None)
            tracked = None if last is None else self._track(last.association.nodes, gray)
            if tracked is not None and scored.member.kernel.in_space:
                tracked = lifted_nodes(tracked, depth)
            best = scored.associations(scored.best(self.skill.top_k), self._axes.get(name))
            selected = self._keep(last, tracked, scored, score_std, bool(best) and best[0].is_at_goal, gray)
            kept = selected is not None
            if selected is None and best:
                first = _first_selected(best, last)
                selected = _Selected(first, _appearance(first.nodes, gray))
            if selected is not None:
                self._selected[name] = selected
                best = _with_first(selected.association, best)
            listed[name] = best
            status = self._statuses.setdefault(name, StatusOverTime(name, scored.member, self._config.innovation))
            statuses[name] = status.advance(tracked, best, kept=kept)
        self._previous_gray = gray
        return scored_frame.result(listed, statuses)

    def _track(self, nodes: Sequence[Node], gray: UInt8[np.ndarray, "height width"]) -> tuple[Node, ...] | None:
        """Return nodes of the previous frame where flow leads them, or None when it loses one of them."""
        if self._previous_gray is None:
            return None
        return track_nodes(nodes, partial(track_sparse, start=self._previous_gray, end=gray))

    def _co_moving(self, scored: ScoredInstances) -> Bool[Tensor, " m"]:
        member, graph = scored.member, scored.graph
        geometry = {
            node_type: rows.numpy(force=True) for node_type, rows in member.attribute(graph, "geometry").items()
        }
        co_moving = self._co_motion.co_moving(member.kernel, geometry, graph.instance_index.numpy(force=True))
        return torch.from_numpy(co_moving).to(scored.scores.device)

    def _keep(
        self,
        selected: _Selected | None,
        nodes: tuple[Node, ...] | None,
        scored: ScoredInstances,
        score_std: float,
        best_is_at_goal: bool,
        gray: UInt8[np.ndarray, "height width"],
    ) -> _Selected | None:
        """Return the selected association as of this frame, or None when it is dropped.

        Args:
            selected: as of the previous frame; None where nothing was selected.
            nodes: of it, tracked to this frame; None where one was lost.
            scored: instances of this frame, co-moving ones penalized.
            score_std: standard deviation of the scores without the penalty.
            best_is_at_goal: whether the best association of this frame is at its goal. One that is at its goal is not
                left for another that is not.
            gray: this frame.
        """
        if selected is None or nodes is None or len(scored) == 0:
            return None
        found = _find(scored, nodes)
        geometry = scored.member.attribute(scored.graph, "geometry")
        now = [
            torch.tensor(node.coordinates) if found is None else geometry[node.node_type][found[role]]
            for role, node in enumerate(nodes)
        ]
        axis = self._turn(scored.name, scored.member, selected.association.nodes, now)
        instance = None if found is None else scored.find(found)
        if found is None or instance is None:
            occluded = any(
                not matches(before, now)
                for before, now in zip(selected.appearance, _appearance(nodes, gray), strict=True)
            )
            if occluded or selected.missed == self._config.max_missed_frames:
                return None
            association = _moved(scored.member, selected.association, nodes, axis)
            return replace(selected, association=association, missed=selected.missed + 1)
        best = scored.best(1)  # none where only a pinned one is allowed, and looks otherwise now
        difference = float(scored.scores[best[0]] - scored.scores[instance]) if best else 0.0
        margin = difference / score_std if score_std > 0 else 0.0
        excess = max(0.0, selected.excess + margin - self._config.tolerated_margin)
        association = scored.association(instance, found, axis)
        if association.is_at_goal and not best_is_at_goal:
            excess = selected.excess
        if excess > self._config.patience:
            return None
        return _Selected(association, _appearance(association.nodes, gray), excess)

    def _turn(
        self, name: str, member: KernelModel, before: Sequence[Node], now: Sequence[Float[Tensor, " _"]]
    ) -> Float[Tensor, "2"]:
        """Turn a member's axis as the selected reference line has turned since the last frame, and return it.

        So a line or a camera that turns slowly, by however much, keeps the sign of the error, and lines that are
        selected later are directed as they would have been before.
        """
        axis, reference = self._axes.get(name, member.reference_axis), reference_line(member.kernel)
        if reference is not None:
            line = torch.tensor([before[reference].coordinates])
            axis = turned(axis.to(line)[None], line, now[reference].to(line)[None])[0]
        self._axes[name] = axis
        return axis


def _appearance(nodes: Sequence[Node], gray: UInt8[np.ndarray, "height width"]) -> tuple[np.ndarray, ...]:
    return tuple(patches_at(gray, node.node_type, node.coordinates) for node in nodes)


def _find(scored: ScoredInstances, nodes: Sequence[Node]) -> list[int] | None:
    """Return the detections nearest to the tracked nodes, in their order, or None when not all are detected."""
    geometry = scored.member.attribute(scored.graph, "geometry")
    features = []
    for node in nodes:
        feature = find_feature(node, geometry[node.node_type].numpy(force=True))
        if feature is None:
            return None
        features.append(feature)
    return features


def _moved(
    member: KernelModel, association: Association, nodes: tuple[Node, ...], axis: Float[Tensor, "2"]
) -> Association:
    """Return an association whose nodes are where flow tracked them; its goal moves along with a resting node."""
    error, std = error_of_nodes(member.kernel, nodes)
    goal = association.goal
    if goal is not None and member.kernel.in_space:
        goal = moved_goal(member, goal, association.nodes, nodes)
    elif goal is not None:
        resting = goal.nodes.index(None)
        shift = np.subtract(nodes[resting].center, association.nodes[resting].center)
        places = [place and tuple(np.reshape(np.reshape(place, (-1, 2)) + shift, -1).tolist()) for place in goal.nodes]
        (goal,) = goals_of(member, [nodes], [tuple(places)], axis)
    return replace(association, nodes=nodes, error=error, error_std=std, goal=goal)


def _first_selected(best: Sequence[Association], last: _Selected | None) -> Association:
    """Return the best association, or the best one at its goal where the last one was at its goal, too."""
    if last is not None and last.association.is_at_goal:
        return next((association for association in best if association.is_at_goal), best[0])
    return best[0]


def _with_first(selected: Association, best: Sequence[Association]) -> list[Association]:
    """Return the selected association, then the best others, ranked anew; as many as in ``best``, but at least one."""

    def joined(association: Association) -> frozenset[tuple[str, int | None]]:
        return frozenset((node.node_type, node.feature) for node in association.nodes)

    others = [association for association in best if joined(association) != joined(selected)]
    listed = [selected, *others][: max(1, len(best))]
    return [replace(association, rank=rank) for rank, association in enumerate(listed, start=1)]
