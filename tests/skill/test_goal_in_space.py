"""Goals in space: a target that turned, a goal beside it, and what cannot be told."""

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from geoskill.config import FeaturesConfig
from geoskill.geometry.depth_camera import DepthCamera
from geoskill.geometry.primitives import NodeType
from geoskill.graphs.motif_graph import MotifGraph
from geoskill.model.kernel_model import KernelModel
from geoskill.skill.association import Node
from geoskill.skill.goal_in_space import SpaceGoalFinder, goal_in_space, moved_goal
from geoskill.skill.spec import build_skill, plan_skill

POINT = NodeType.POINT
CAMERA = DepthCamera(600.0, 600.0, 319.5, 239.5)
TURN, SHIFT = Rotation.from_rotvec([0.0, 0.1, 0.6]).as_matrix(), np.array([0.04, 0.03, 0.02])
COUNT = 10
# Beside and above the target, at the end of the demonstration.
END = np.array([0.03, -0.02, 0.66])


def unit_rows(count: int) -> np.ndarray:
    rows = np.random.default_rng(0).normal(size=(count, 128))
    return (rows / np.linalg.norm(rows, axis=1, keepdims=True)).astype(np.float32)


DESCRIPTORS = unit_rows(COUNT + 1)
TARGET = np.random.default_rng(1).uniform(-0.08, 0.08, (COUNT, 3)) * [1, 1, 0.2] + np.array([0.0, 0.0, 0.7])


@pytest.fixture
def member() -> KernelModel:
    """A p2p3 whose first feature moves to :data:`END`, beside a target of ten points."""
    features = FeaturesConfig(max_features=12, min_side=0, color=0.0)
    spec = plan_skill("p2p3", "sift", {"name": "bilinear", "hidden_dim": 8}, features, top_k=3)
    (own,) = build_skill(spec).members.values()
    descriptors, target = torch.from_numpy(DESCRIPTORS), torch.from_numpy(TARGET.astype(np.float32))
    own.goal.fit(
        torch.tensor([True, False]),
        [(descriptors[:1], torch.from_numpy(END[None].astype(np.float32))), (descriptors[1:2], target[:1])],
        {POINT: (descriptors[1:], target)},
        {POINT: (torch.zeros(0, 128), torch.zeros(0, 3))},
        {POINT: 0.5},
    )
    own.goal.set_tolerance(0.0045)
    return own


def frame(moving: np.ndarray, target: np.ndarray) -> MotifGraph:
    space = np.concatenate([moving[None], target]).astype(np.float32)
    return MotifGraph(point_descriptor=torch.from_numpy(DESCRIPTORS), point_space=torch.from_numpy(space))


def node(graph: MotifGraph, feature: int) -> Node:
    space = graph.point_space[feature].numpy().astype(np.float64)
    covariance = tuple(map(tuple, np.diag([1e-6, 1e-6, 4e-6]).tolist()))
    return Node(POINT, tuple(CAMERA.project(space).tolist()), feature, None, tuple(space.tolist()), covariance)


def test_goal_goes_with_a_target_that_turned(member: KernelModel) -> None:
    moving = np.array([0.2, 0.1, 0.5])
    graph = frame(moving, TARGET @ TURN.T + SHIFT)
    nodes = [node(graph, 0), node(graph, 1)]
    (goal,) = SpaceGoalFinder(member, graph, CAMERA).goals([[0, 1]], [nodes])
    belongs = TURN @ END + SHIFT
    np.testing.assert_allclose(goal.space[0], belongs, atol=1e-6)
    np.testing.assert_allclose(goal.error, moving - belongs, atol=1e-6)
    np.testing.assert_allclose(goal.nodes[0], CAMERA.project(belongs), atol=1e-3)
    assert goal.nodes[1] is goal.space[1] is None
    # The resting node cancels; both ends of the way have the moving node's noise.
    np.testing.assert_allclose(goal.std, np.sqrt([2e-6, 2e-6, 8e-6]), rtol=1e-4)
    assert goal.tolerance == pytest.approx(0.0045)


def test_at_the_demonstrated_end_nothing_is_left_though_the_points_do_not_meet(member: KernelModel) -> None:
    graph = frame(TURN @ END + SHIFT, TARGET @ TURN.T + SHIFT)
    (goal,) = SpaceGoalFinder(member, graph, None).goals([[0, 1]], [[node(graph, 0), node(graph, 1)]])
    assert np.linalg.norm(goal.error) < 1e-6
    assert goal.nodes == (None, None)


def test_goal_moves_along_with_a_tracked_resting_point(member: KernelModel) -> None:
    graph = frame(np.array([0.2, 0.1, 0.5]), TARGET)
    before = [node(graph, 0), node(graph, 1)]
    goal = goal_in_space(member, before, (tuple(END.tolist()), None), CAMERA)
    shift = np.array([0.01, 0.0, -0.02])
    later = frame(np.array([0.15, 0.1, 0.5]), TARGET + shift)
    moved = moved_goal(member, goal, before, [node(later, 0), node(later, 1)])
    np.testing.assert_allclose(moved.error, np.array([0.15, 0.1, 0.5]) - END - shift, atol=1e-6)


@pytest.mark.parametrize("case", ["target unknown", "target of other points", "moving point unknown", "no depth"])
def test_what_cannot_be_told_has_no_goal(case: str, member: KernelModel) -> None:
    target = TARGET.copy()
    graph = frame(END, target)
    if case == "target unknown":
        graph.point_descriptor = torch.cat([graph.point_descriptor[:1], -graph.point_descriptor[1:]])
    elif case == "target of other points":
        graph.point_space[2:] = torch.from_numpy(np.random.default_rng(5).uniform(-0.3, 0.3, (COUNT - 1, 3))).float()
    elif case == "moving point unknown":
        graph.point_descriptor = torch.cat([-graph.point_descriptor[:1], graph.point_descriptor[1:]])
    else:
        graph.point_space[2:] = torch.nan
    nodes = [node(graph, 0), node(graph, 1)]
    assert SpaceGoalFinder(member, graph, CAMERA).goals([[0, 1]], [nodes]) == [None]
