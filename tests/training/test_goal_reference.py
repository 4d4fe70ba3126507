"""The goal of a demonstration in which a tile slides 2.5 pixels a frame to another, against where the tiles are."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import torch

from geoskill.config import FeaturesConfig, ObjectiveConfig
from geoskill.features.feature_set import FeatureSet
from geoskill.geometry.primitives import NodeType
from geoskill.graphs.motif_graph import MotifGraph, motif_graph
from geoskill.model.kernel_model import KernelModel
from geoskill.skill.association import Association, NodeRole
from geoskill.skill.build import SkillComponents
from geoskill.skill.checkpoint import Provenance
from geoskill.skill.plan import plan_skill
from geoskill.skill.scored_frame import ScoredInstances
from geoskill.skill.skill import Skill
from geoskill.skill.spec import SkillSpec
from geoskill.training.error_changes import fit_reward_scale, instance_goal_progress
from geoskill.training.goal_reference import fit_goal_reference
from geoskill.training.node_order import fit_node_order
from geoskill.training.selected_frames import first_demonstration
from tests.training_runs import Training

LAST = 19
STEP_PX = 2.5
Pixels = np.ndarray


# Making the members takes some seconds.
pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def trained(
    demonstration_frames: Sequence[np.ndarray],
) -> tuple[dict[str, KernelModel], Training, SkillSpec]:
    """Return p2p and l2l members that select what progresses most, with their goal references."""
    plan = plan_skill(
        ["p2p", "l2l"],
        ["sift", "lbd"],
        {"name": "bilinear", "hidden_dim": 4},
        FeaturesConfig(max_features=50, min_side=480, color=0.0),
        top_k=4,
    )
    own = Training(demonstration_frames, plan)
    members = own.members()
    fit_reward_scale(members, own.demonstration, ObjectiveConfig())
    fit_node_order(members, own.demonstration, ObjectiveConfig(), 0.1)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(KernelModel, "forward", lambda self, graph: 50 * instance_goal_progress(self, graph))
        for name, member in members.items():
            fit_goal_reference(name, member, first_demonstration(name, own.demonstration))
    return members, own, plan


def associations(
    trained: tuple[dict[str, KernelModel], Training, SkillSpec], name: str, picture: np.ndarray
) -> list[Association]:
    """Return all associations of a picture that have a goal."""
    members, own, _ = trained
    member = members[name]
    features = {kind: own.pipelines[extractor].extract(picture) for kind, extractor in member.extractors.items()}
    graph = motif_graph(member.kernel, features)
    zeros = torch.zeros(graph.instance_index.shape[1])
    scored = ScoredInstances(name, member, graph, zeros, torch.softmax(zeros, 0))
    return [own for own in scored.associations(range(len(zeros))) if own.goal is not None]


def joins_tiles(association: Association, frame: int, back: Callable[[Pixels], Pixels] = lambda xy: xy) -> bool:
    """Return whether the first node is on the moving tile and the second on the resting one, 4 px from other things."""
    left = 28 + STEP_PX * frame
    (x, y), (u, v) = (back(np.array(node.center)) for node in association.nodes)
    return bool(left + 2 < x < left + 28 and 48 < y < 76 and 112 < u < 142 and 44 < v < 80)


def right_share(found: Sequence[Association], expected: Sequence[float]) -> float:
    """Return the share of goal errors within 5 px of the expected one: squares of 8 px look alike in gray."""
    errors = np.array([own.goal.error for own in found if own.goal is not None])
    return float((np.linalg.norm(errors - np.asarray(expected), axis=1) < 5).mean())


@pytest.mark.parametrize("name", ["p2p_sift", "l2l_lbd"])
def test_moving_node_and_tolerance_are_learned(trained: Any, name: str) -> None:
    goal = trained[0][name].goal
    assert goal.is_fitted
    assert goal.moving.tolist() == [True, False]
    assert 0 < float(goal.tolerance) < 16
    assert len(goal.node(0)[1]) == len(goal.node(1)[1]) <= 256


@pytest.mark.parametrize("frame", [1, 8, 15])
def test_goal_error_of_points_is_the_way_that_is_left(
    trained: Any, demonstration_frames: Sequence[np.ndarray], frame: int
) -> None:
    found = [own for own in associations(trained, "p2p_sift", demonstration_frames[frame]) if joins_tiles(own, frame)]
    assert len(found) >= 3
    assert right_share(found, (STEP_PX * (frame - LAST), 0.0)) >= 0.75
    for own in found:
        assert own.goal is not None
        assert [node.role for node in own.nodes] == [NodeRole.MOVING, NodeRole.RESTING]
        # T m* is how the demonstration ended: the moving node is off by what is left.
        assert own.goal.nodes[0] == pytest.approx(np.subtract(own.nodes[0].coordinates, own.goal.error), abs=1e-3)
        assert own.goal.nodes[1] is None
        assert own.goal.std == pytest.approx((0.7071, 0.7071), abs=1e-3)


def test_goal_error_follows_a_camera_that_turns_and_comes_nearer(
    trained: Any, demonstration_frames: Sequence[np.ndarray]
) -> None:
    frame = 8
    warp = cv2.getRotationMatrix2D((80, 60), 14.0, 1.15)
    picture = cv2.warpAffine(demonstration_frames[frame], warp, (160, 120), borderValue=(128, 128, 128))
    inverse = cv2.invertAffineTransform(warp)

    def back(xy: np.ndarray) -> np.ndarray:
        return np.asarray(inverse[:, :2] @ xy + inverse[:, 2])

    found = [own for own in associations(trained, "p2p_sift", picture) if joins_tiles(own, frame, back)]
    assert found
    assert right_share(found, warp[:, :2] @ (STEP_PX * (frame - LAST), 0.0)) >= 0.75


def test_goal_error_follows_a_target_that_was_moved(trained: Any, demonstration_frames: Sequence[np.ndarray]) -> None:
    """What else rests, stays; the map has to be the target's."""
    frame = 2
    picture = demonstration_frames[frame].copy()
    target = picture[46:78, 108:140].copy()
    picture[46:78, 108:140] = 128
    picture[16:48, 118:150] = target
    found = [
        own
        for own in associations(trained, "p2p_sift", picture)
        if joins_tiles(own, frame, lambda xy: xy - (10, -30) if xy[0] > 100 else xy)
    ]
    assert len(found) >= 2
    assert right_share(found, (STEP_PX * (frame - LAST) - 10, 30.0)) >= 0.75


def test_error_of_lines_is_at_its_goal_in_the_end(trained: Any, demonstration_frames: Sequence[np.ndarray]) -> None:
    found = [own for own in associations(trained, "l2l_lbd", demonstration_frames[17]) if joins_tiles(own, 17)]
    assert found
    left = [np.abs(own.goal.error).max() for own in found if own.goal is not None]
    assert np.median(left) < STEP_PX * 2 + 3


def test_nothing_known_gives_no_goal(trained: Any, demonstration_frames: Sequence[np.ndarray]) -> None:
    noise = np.random.default_rng(0).integers(0, 255, (120, 160, 3), np.uint8)
    assert len(associations(trained, "p2p_sift", noise)) == 0
    fresh = trained[1].members()
    assert not fresh["p2p_sift"].goal.is_fitted
    assert associations((fresh, *trained[1:]), "p2p_sift", demonstration_frames[3]) == []


def test_goal_survives_a_checkpoint(trained: Any, tmp_path: Path) -> None:
    members, own, plan = trained
    provenance = Provenance(("tiles",), (160, 120), "2026-01-01", "0", 1, finished=True)
    Skill(SkillComponents(members, own.pipelines), plan, provenance).save(tmp_path / "skill.ckpt")
    loaded = Skill.load(tmp_path / "skill.ckpt").members["p2p_sift"].goal
    assert loaded.is_fitted
    for key, value in members["p2p_sift"].goal.state_dict().items():
        assert torch.equal(loaded.state_dict()[key], value), key


def test_look_alikes_that_end_elsewhere_have_no_goal(trained: Any) -> None:
    members, own, _ = trained
    member = members["p2p_sift"]
    descriptor = torch.nn.functional.normalize(torch.ones(3, member.goal.node(0)[0].shape[1]), dim=1)
    ends = torch.tensor([[10.0, 10.0], [60.0, 90.0], [100.0, 20.0]])
    places = torch.tensor([[0.0, 0.0], [50.0, 0.0], [0.0, 50.0], [50.0, 60.0], [30.0, 20.0]])
    others = torch.eye(descriptor.shape[1])[:5]
    graph = _graph(member, torch.cat([descriptor[:1], others]), torch.cat([torch.tensor([[70.0, 70.0]]), places]))
    fresh = own.members()["p2p_sift"]
    for same, expected in ((ends, False), (ends[[0, 0, 0]], True)):
        fresh.goal.fit(
            torch.tensor([True, False]),
            [(descriptor, same), (others[:3], places[:3])],
            {NodeType.POINT: (others, places)},
            {NodeType.POINT: (descriptor, same)},
            {NodeType.POINT: 0.5},
        )
        zeros = torch.zeros(graph.instance_index.shape[1])
        scored = ScoredInstances("m", fresh, graph, zeros, zeros)
        instance = scored.find([0, 5])
        assert instance is not None
        goal = scored.association(instance, [0, 5]).goal
        # The partner is none of those that they were stored with, so it does not tell them apart.
        assert (goal is not None) == expected
        assert goal is None or goal.error == pytest.approx((60.0, 60.0), abs=1e-4)


def _graph(member: KernelModel, descriptors: torch.Tensor, geometry: torch.Tensor) -> MotifGraph:
    features = FeatureSet(NodeType.POINT, descriptors.numpy(), geometry.numpy(), np.zeros(len(geometry), np.float32))
    return motif_graph(member.kernel, {NodeType.POINT: features})
