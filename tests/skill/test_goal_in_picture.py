"""Goals in the picture of kernels whose resting node is no point and no line."""

import numpy as np
import torch

from geoskill.config import FeaturesConfig
from geoskill.geometry.ellipses import ellipse_of_axes
from geoskill.geometry.primitives import NodeType
from geoskill.graphs.motif_graph import MotifGraph
from geoskill.skill.association import Node
from geoskill.skill.build import build_skill
from geoskill.skill.goal import GoalFinder
from geoskill.skill.plan import plan_skill

POINT, CONIC = NodeType.POINT, NodeType.CONIC


def unit_rows(count: int) -> np.ndarray:
    rows = np.random.default_rng(0).normal(size=(count, 128))
    return (rows / np.linalg.norm(rows, axis=1, keepdims=True)).astype(np.float32)


def test_both_sides_of_a_ring_have_the_goal_of_one_map() -> None:
    features = FeaturesConfig(max_features=12, min_side=0, color=0.0)
    spec = plan_skill("p2c", ["sift", "conics"], {"name": "bilinear", "hidden_dim": 8}, features, top_k=3)
    (member,) = build_skill(spec).members.values()
    points, ellipses = torch.from_numpy(unit_rows(7)), torch.from_numpy(unit_rows(2))
    around = torch.from_numpy(np.random.default_rng(1).uniform(60, 260, (6, 2)).astype(np.float32))
    rings = torch.tensor(np.stack([ellipse_of_axes((160.0, 160.0), (a, 0.6 * a), 0.1) for a in (40.0, 48.0)])).float()
    end = torch.tensor([[200.0, 164.0]])
    member.goal.fit(
        torch.tensor([True, False]),
        [(points[[0, 0]], end.repeat(2, 1)), (ellipses, rings)],
        {POINT: (points[1:], around), CONIC: (ellipses, rings)},
        {POINT: (points[:1], end), CONIC: (ellipses[:0], rings[:0])},
        {POINT: 0.5, CONIC: 0.5},
    )
    shift = torch.tensor([30.0, -12.0])
    now = torch.cat([torch.tensor([[400.0, 300.0]]), around + shift])
    graph = MotifGraph(
        point_descriptor=points, point_geometry=now, conic_descriptor=ellipses, conic_geometry=rings + shift.repeat(4)
    )
    nodes = [
        (Node(POINT, (400.0, 300.0), 0), Node(CONIC, tuple(graph.conic_geometry[row].tolist()), row)) for row in (0, 1)
    ]
    for goal in GoalFinder(member, graph).goals([[0, 0], [0, 1]], nodes, torch.tensor([1.0, 0.0])):
        assert goal is not None
        np.testing.assert_allclose(goal.nodes[0], (end[0] + shift).numpy(), atol=0.01)
