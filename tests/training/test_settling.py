"""When a member's associations settle, by hand and in simulated insertions."""

from collections.abc import Sequence

import numpy as np
import pytest
import torch

from geoskill.cli.sequences import simulated_recording
from geoskill.config import FeaturesConfig, ScenarioConfig
from geoskill.control.settling import Settling
from geoskill.data.demonstration import Demonstration
from geoskill.features.feature_set import FeatureSet
from geoskill.geometry.primitives import NodeType
from geoskill.graphs.motif_graph import MotifGraph, motif_graph
from geoskill.kernels.p2p import PointToPoint
from geoskill.model.bilinear import Bilinear
from geoskill.model.kernel_model import KernelModel
from geoskill.model.scorer import Motif
from geoskill.skill.build import build_skill
from geoskill.skill.checkpoint import SimulatedScene
from geoskill.skill.plan import plan_skill
from geoskill.tracking.motion import Part, Trajectory
from geoskill.training.error_changes import instance_goal_progress
from geoskill.training.selected_frames import first_demonstration
from geoskill.training.settling import fit_settling

POINT = NodeType.POINT


def member() -> KernelModel:
    own = KernelModel(PointToPoint(), {POINT: "sift"}, Bilinear(Motif.of(PointToPoint(), {POINT: 4}), hidden_dim=2))
    own.set_reward_scale(torch.tensor([2]), torch.tensor([1.0]))
    return own


def frame(left: float, end: float = 0.0, known: bool = True) -> MotifGraph:
    """A point that has ``left`` px to go, of 100 px, until it is ``end`` px beside its target at the origin."""
    geometry = np.array([[end + left, 0.0], [0.0, 0.0]], np.float32)
    final = torch.tensor([[end, 0.0], [0.0, 0.0]])
    anchors = torch.tensor([[[100.0, 0.0]], [[0.0, 0.0]]])
    trajectory = Trajectory(
        anchors, torch.tensor([0, 0]), final, torch.tensor([known, known]), torch.full((2,), Part.UNKNOWN)
    )
    features = FeatureSet(POINT, np.eye(2, 4, dtype=np.float32), geometry, np.zeros(2, np.float32))
    return motif_graph(PointToPoint(), {POINT: features}, None, {POINT: trajectory})


def settling(left: Sequence[float], **options: float) -> Settling | None:
    own = member()
    fit_settling(own, [frame(value, **options) for value in left])
    return own.settling


def test_settling_by_hand() -> None:
    # Of 40 frames, two of which begin no transition, the 16th is the first that stays below 3 px.
    left = [*range(60, 0, -4), *[1.0] * 23]
    assert settling(left) == Settling(0.375, 3.0, 1.0)


def test_settling_does_not_depend_on_where_an_association_ends() -> None:
    left = [*range(60, 0, -4), *[1.0] * 23]
    beside = settling(left, end=20.0)
    assert beside == Settling(0.375, 3.0, 21.0)


def test_settling_takes_no_notice_of_two_frames_but_of_three() -> None:
    left = [50.0] * 10 + [0.0] * 28
    for count, share in ((2, 10 / 40), (3, 23 / 40)):
        left[20 : 20 + count] = [9.0] * count
        found = settling(left)
        assert found is not None
        assert found.share == pytest.approx(share)


def test_settling_threshold_of_a_restless_end() -> None:
    found = settling([50.0] * 10 + [4.0] * 28)
    assert found == Settling(0.25, 6.0, 4.0)


def test_settling_is_not_known_of_what_never_came_together() -> None:
    assert settling([50.0] * 38, end=60.0) is None
    own = member()
    fit_settling(own, [frame(1.0, known=False)])
    fit_settling(own, [])
    assert own.settling is None


def test_settling_is_kept_in_the_state_of_a_member() -> None:
    own, fresh = member(), member()
    fit_settling(own, [frame(value) for value in (50.0, 20.0, 0.0, 0.0)])
    fresh.load_state_dict(own.state_dict())
    assert fresh.settling == own.settling is not None


@pytest.mark.slow  # half a minute each
@pytest.mark.usefixtures("annotations_unchecked")
@pytest.mark.parametrize("take", ["demonstration", *(f"demonstration {number}" for number in range(2, 6))])
def test_insertion_aligns_before_it_coincides(take: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of what makes the most progress in a frame, lines settle before points do (docs/experiments/phases.md)."""
    recording = simulated_recording(SimulatedScene("insertion", 0, ScenarioConfig()), take, None)
    pictures = [recording.picture(frame) for frame in range(len(recording))]
    spec = plan_skill(["p2p", "l2l"], ["sift", "lbd"], {"name": "bilinear", "hidden_dim": 4}, FeaturesConfig(), 4)
    components = build_skill(spec)
    demonstration = Demonstration(
        pictures,
        components.pipelines,
        components.members,
        gap=2,
        max_span_ratio=0.0,
        num_negatives=0,
        progress=lambda items, description: items,
    )
    monkeypatch.setattr(KernelModel, "forward", lambda self, graph: instance_goal_progress(self, graph))
    shares = {}
    for name, own in components.members.items():
        own.set_reward_scale(torch.tensor([2]), torch.tensor([1.0]))
        fit_settling(own, first_demonstration(name, demonstration))
        assert own.settling is not None
        shares[name] = own.settling.share
    assert 0.55 < shares["l2l_lbd"] < shares["p2p_sift"]
    # The block is let down onto the floor of the slot until 0.85 of the video, ever slower.
    assert shares["p2p_sift"] == pytest.approx(0.80, abs=0.015)
