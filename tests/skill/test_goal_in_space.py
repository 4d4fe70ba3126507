"""Goals in space: a target that turned, a goal beside it, of points, lines and planes, and what cannot be told."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from geoskill.config import FeaturesConfig
from geoskill.geometry.depth_camera import DepthCamera
from geoskill.geometry.primitives import NodeType
from geoskill.graphs.motif_graph import MotifGraph
from geoskill.model.kernel_model import KernelModel
from geoskill.skill.association import Goal, Node
from geoskill.skill.build import build_skill
from geoskill.skill.goal_in_space import SpaceGoalFinder, goal_in_space, moved_goal
from geoskill.skill.plan import plan_skill

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


LINE, PLANE = NodeType.LINE, NodeType.PLANE
# Edges of the target, and one of the moving thing that ends 4 mm beside the first of them.
LINES = np.hstack([TARGET[:6], TARGET[4:10]])
LINE_END = LINES[0] + np.tile([0.0, 0.004, 0.0], 2)
# A point that ends 2 mm above a plane of the target.
NORMAL = np.array([0.0, 0.6, -0.8])
PLANE_END = np.append(NORMAL, 0.002 - NORMAL @ END)


def other_member(kernel: str, moving: tuple[bool, bool], ends: list[np.ndarray]) -> KernelModel:
    """A member with one stored instance, whose nodes have the first descriptors, and all of TARGET around."""
    features = FeaturesConfig(max_features=12, min_side=0, color=0.0)
    spec = plan_skill(kernel, ["sift", "lbd"], {"name": "bilinear", "hidden_dim": 8}, features, top_k=3)
    (own,) = build_skill(spec).members.values()
    stored = [
        (torch.from_numpy(width_of(kind)[[row]]), torch.from_numpy(end[None].astype(np.float32)))
        for row, (kind, end) in enumerate(zip(own.kernel.roles, ends, strict=True))
    ]
    around = {POINT: (DESCRIPTORS[1:], TARGET), LINE: (width_of(LINE)[1:7], LINES)}
    around |= {PLANE: (np.zeros((0, 128), np.float32), np.zeros((0, 4)))}
    own.goal.fit(
        torch.tensor(moving),
        stored,
        {kind: tuple(torch.from_numpy(rows.astype(np.float32)) for rows in around[kind]) for kind in own.node_types},
        {kind: (torch.zeros(0, width_of(kind).shape[1]), torch.zeros(0, kind.space_dim)) for kind in own.node_types},
        dict.fromkeys(own.node_types, 0.5),
    )
    return own


def width_of(kind: NodeType) -> np.ndarray:
    """Descriptors as long as those of a type's extractor."""
    return (
        DESCRIPTORS[:, :72] / np.linalg.norm(DESCRIPTORS[:, :72], axis=1, keepdims=True)
        if kind is LINE
        else DESCRIPTORS
    )


def moved(kind: NodeType, place: np.ndarray) -> np.ndarray:
    """A feature of the target after it turned."""
    if kind is PLANE:
        return np.append(TURN @ place[:3], place[3] - TURN @ place[:3] @ SHIFT)
    return (place.reshape(-1, 3) @ TURN.T + SHIFT).ravel()


def goal_of(
    own: KernelModel, places: dict[NodeType, np.ndarray], features: list[int]
) -> tuple[Goal | None, list[Node]]:
    """The goal of one association in a frame with these features in space."""
    graph = MotifGraph()
    for kind in own.node_types:
        graph[f"{kind}_descriptor"] = torch.from_numpy(width_of(kind)[: len(places[kind])])
        graph[f"{kind}_space"] = torch.from_numpy(places[kind].astype(np.float32))
    nodes = []
    for kind, feature in zip(own.kernel.roles, features, strict=True):
        space = tuple(places[kind][feature].tolist())
        covariance = tuple(map(tuple, (1e-6 * np.eye(len(space))).tolist()))
        nodes.append(Node(kind, (0.0,) * kind.geometry_dim, feature, None, space, covariance))
    (goal,) = SpaceGoalFinder(own, graph, CAMERA).goals([features], [nodes])
    return goal, nodes


AWAY = np.array([0.1, -0.05, -0.1])
POINTS_NOW = np.concatenate([(TURN @ END + SHIFT + AWAY)[None], TARGET @ TURN.T + SHIFT])
LINES_NOW = np.array([moved(LINE, line) for line in LINES])


@pytest.mark.parametrize("moving", [(True, False), (False, True)], ids=["point moves", "line moves"])
def test_goal_of_a_point_and_a_line(moving: tuple[bool, bool]) -> None:
    own = other_member("p2l3", moving, [END if moving[0] else TARGET[0], LINES[0]])
    # The first line has the second descriptor, as it is stored as node 1.
    lines = np.concatenate([np.full((1, 6), np.nan), LINES_NOW])
    if moving[0]:
        goal, _ = goal_of(own, {POINT: POINTS_NOW, LINE: lines}, [0, 1])
        along = LINES_NOW[0, 3:] - LINES_NOW[0, :3]
        along = along / np.linalg.norm(along)
        expected = AWAY - (AWAY @ along) * along
        np.testing.assert_allclose(goal.space[0], TURN @ END + SHIFT, atol=1e-5)
    else:
        own.goal.node0_descriptor = torch.from_numpy(DESCRIPTORS[1:2])
        lines[1] += np.tile(AWAY, 2)
        goal, _ = goal_of(own, {POINT: POINTS_NOW, LINE: lines}, [1, 1])
        along = LINES_NOW[0, 3:] - LINES_NOW[0, :3]
        along = along / np.linalg.norm(along)
        expected = -(AWAY - (AWAY @ along) * along)  # the point is not yet there, as seen from the line
    np.testing.assert_allclose(goal.error, expected, atol=2e-5)


def test_goal_of_two_lines_by_lines_alone() -> None:
    own = other_member("l2l3", (True, False), [LINE_END, LINES[0]])
    present = moved(LINE, LINE_END) + np.tile(AWAY, 2)
    goal, _ = goal_of(own, {LINE: np.concatenate([present[None], LINES_NOW])}, [0, 1])
    np.testing.assert_allclose(goal.space[0], moved(LINE, LINE_END), atol=1e-4)
    assert len(goal.nodes[0]) == 4
    # Parallel lines that miss by a: both ends by a / sqrt 2; what is left is the way, not the offset in the end.
    along = (LINES_NOW[0, 3:] - LINES_NOW[0, :3]) / np.linalg.norm(LINES_NOW[0, 3:] - LINES_NOW[0, :3])
    expected = (AWAY - (AWAY @ along) * along) / np.sqrt(2)
    np.testing.assert_allclose(goal.error, np.tile(expected, 2), atol=2e-3)
    goal, _ = goal_of(own, {LINE: np.concatenate([moved(LINE, LINE_END)[None], LINES_NOW])}, [0, 1])
    assert np.linalg.norm(goal.error) < 1e-4


@pytest.mark.parametrize("moves", [POINT, PLANE])
def test_goal_of_a_point_and_a_plane_needs_no_motion(moves: NodeType) -> None:
    own = other_member("p2pl", (moves is POINT, moves is PLANE), [END, PLANE_END])
    plane = moved(PLANE, PLANE_END)
    if moves is PLANE:
        plane[3] -= plane[:3] @ AWAY
    # Nothing else of the target is seen.
    planes = np.stack([np.full(4, np.nan), plane])
    start = TURN @ END + SHIFT
    point = start + AWAY if moves is POINT else start
    goal, nodes = goal_of(own, {POINT: point[None], PLANE: planes}, [0, 1])
    normal = plane[:3]
    expected = normal @ AWAY * (1 if moves is POINT else -1)
    np.testing.assert_allclose(goal.error, [expected], atol=1e-6)
    if moves is POINT:
        np.testing.assert_allclose(np.array(goal.space[0]) - point, -expected * normal, atol=1e-6)
        assert goal.nodes[0] == pytest.approx(tuple(CAMERA.project(np.array(goal.space[0]))), abs=1e-3)
    else:
        assert goal.nodes == (None, None)
    # A plane that comes 1 cm nearer to the camera takes the goal along.
    later = [nodes[0], replace(nodes[1], space=(*nodes[1].space[:3], nodes[1].space[3] - 0.01))]
    if moves is POINT:
        assert moved_goal(own, goal, nodes, later).error[0] == pytest.approx(expected - 0.01, abs=1e-6)


def test_lines_in_one_plane_have_no_goal() -> None:
    own = other_member("copl2", (True, False), [LINE_END, LINES[0]])
    assert goal_of(own, {LINE: np.concatenate([LINE_END[None], LINES])}, [0, 1])[0] is None
