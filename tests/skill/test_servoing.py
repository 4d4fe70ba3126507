"""A skill that closes the loop, and what its associations determine."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from geoskill import Servo, Skill
from geoskill.control.action import Limits
from geoskill.control.state import Mode
from geoskill.errors import InputError
from geoskill.features.feature_set import FeatureSet
from geoskill.geometry.primitives import NodeType
from geoskill.kernels.kernel import Kernel
from geoskill.kernels.l2l import LineToLine
from geoskill.kernels.p2l import PointToLine
from geoskill.kernels.p2p import PointToPoint
from geoskill.kernels.par import Parallel
from geoskill.skill.association import Association, Goal, InferenceResult, Node, NodeRole
from geoskill.skill.decidable import decidability_of, satisfied
from geoskill.skill.servoing import FeatureFollower, constraints_of, listing


@pytest.fixture
def skill(skill_file: Path) -> Skill:
    return Skill.load(skill_file)


def association(kernel: Kernel, nodes: Sequence[Sequence[float]], member: str = "m", rank: int = 1) -> Association:
    roles = (NodeRole.MOVING, NodeRole.RESTING)
    own = tuple(
        Node(kind, tuple(map(float, xy)), 0, role) for kind, xy, role in zip(kernel.roles, nodes, roles, strict=True)
    )
    error = kernel.control_error([torch.tensor([node.coordinates]) for node in own])[0].tolist()
    return Association(member, kernel.name, "sift", rank, 0.9, 0.5, own, tuple(error))


def test_servo_begins_with_probing_moves_within_its_limits(
    skill: Skill, demonstration_frames: Sequence[np.ndarray]
) -> None:
    servo = Servo(skill, Limits(step_m=0.004))
    decisions = [servo.step(frame) for frame in demonstration_frames[:3]]
    assert [own.mode for own in decisions] == [Mode.EXPLORE] * 3
    np.testing.assert_allclose(decisions[0].action, [0.004, 0, 0, 0])
    np.testing.assert_allclose(decisions[1].action, [-0.004, 0, 0, 0])
    assert servo.record is not None
    assert servo.record.frame == 2


def test_servo_refuses_what_does_not_fit(skill: Skill, demonstration_frames: Sequence[np.ndarray]) -> None:
    with pytest.raises(InputError, match="dof=all: expected one of descent"):
        Servo(skill, dof="all")
    with pytest.raises(InputError, match="cameras=0: expected at least 1"):
        Servo(skill, cameras=0)
    with pytest.raises(InputError, match="there are 1 pictures; expected 2, one of each camera"):
        Servo(skill, cameras=2).step(demonstration_frames[0])


def test_features_are_followed_backward() -> None:
    rng = np.random.default_rng(0)
    texture = rng.integers(0, 256, (120, 160, 3), np.uint8).repeat(4, axis=0).repeat(4, axis=1)
    before, after = texture[:400, :500].copy(), texture[3:403, 5:505].copy()
    points = np.array([[100.0, 120.0], [300.0, 220.0]], np.float32)
    sets = [
        FeatureSet(NodeType.POINT, np.ones((2, 1), np.float32), points, np.ones(2, np.float32)),
        FeatureSet(
            NodeType.LINE, np.ones((1, 1), np.float32), np.array([[50, 60, 90, 60]], np.float32), np.ones(1, np.float32)
        ),
    ]
    follower = FeatureFollower()
    assert len(follower.follow(before, sets).before) == 0
    followed = follower.follow(after, sets)
    assert len(followed.after) == 5  # two points, two ends and the middle
    np.testing.assert_allclose(followed.before - followed.after, np.tile([5.0, 3.0], (5, 1)), atol=0.2)


def test_goal_error_becomes_the_target_of_each_carried_feature_once(skill: Skill) -> None:
    name = next(iter(skill.members))
    kernel = skill.members[name].kernel

    def of(moving: tuple[int, int], rank: int, left: tuple[float, float] | None) -> Association:
        own = association(kernel, [moving, (14, 26)], name, rank)
        return own if left is None else replace(own, goal=Goal(((12.0, 21.0), None), left, (1.0, 1.0)))

    listed = (
        of((10, 20), 1, (-2.0, -1.0)),
        of((10, 20), 2, (-3.0, -1.0)),
        of((30, 20), 3, None),
        of((9, 9), 4, (1.0, 0.0)),
    )
    first, second = constraints_of(skill, InferenceResult(listed), camera=1)
    assert (first.carried, first.camera, first.rank, second.rank) == ((True, False), 1, 1, 2)
    assert first.target == (-2.0, -5.0)  # error (-4, -6), of which (-2, -1) are left
    assert second.nodes[0].tolist() == [9.0, 9.0]
    without = constraints_of(skill, InferenceResult((listed[2],)))
    assert [own.target for own in without] == [None]
    assert listing(skill).top_k == 60
    assert listing(skill, 1) is skill


@pytest.mark.parametrize(
    ("kernel", "nodes"),
    [
        (PointToPoint(), [(100, 100), (300, 200)]),
        (PointToLine(), [(100, 100), (300, 200, 340, 260)]),
        (LineToLine(), [(100, 100, 160, 110), (300, 200, 340, 260)]),
        (Parallel(), [(100, 100, 160, 110), (300, 200, 340, 260)]),
    ],
    ids=lambda own: getattr(own, "name", ""),
)
def test_carried_nodes_go_to_where_the_error_is_zero(kernel: Kernel, nodes: Sequence[Sequence[float]]) -> None:
    placed, carried = satisfied(kernel, association(kernel, nodes))
    assert carried == (True, False)
    np.testing.assert_array_equal(placed[1], nodes[1])
    assert kernel.control_error([torch.tensor(own[None]) for own in placed]).norm() < 1e-4


def test_decidability_of_selected_associations() -> None:
    point, line = PointToPoint(), LineToLine()
    one = association(point, [(100, 100), (300, 200)], "p2p")
    two = association(point, [(120, 150), (360, 260)], "p2p", rank=2)
    aligned = association(line, [(100, 100, 160, 110), (200, 300, 240, 360)], "l2l")
    kernels = {"p2p": point, "l2l": line}

    def report(*own: Association, max_rank: int | None = None):  # type: ignore[no-untyped-def]
        return decidability_of(kernels, InferenceResult(own), (640, 480), max_rank)

    assert report(one).one_camera.rank == 2
    assert report(one, two).one_camera.rank == 4
    assert report(one, two, max_rank=1).one_camera.rank == 2
    assert report(one, aligned).all_axes[:2] == (4, 6)
    assert report() is None


def test_skill_says_what_is_determined(skill: Skill, demonstration_frames: Sequence[np.ndarray]) -> None:
    report = skill.decidability(skill.infer(demonstration_frames[5]))
    assert report is None or 1 <= report.one_camera.rank <= 4
