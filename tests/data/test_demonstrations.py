"""Several demonstrations as one: every transition is there once, under the right span."""

import numpy as np
import pytest
import torch

from geoskill.config import ObjectiveConfig
from geoskill.data.demonstration import Demonstration
from geoskill.data.demonstrations import Demonstrations
from geoskill.geometry.primitives import NodeType
from geoskill.objective.reward import beta_from_changes
from geoskill.skill.build import build_skill
from geoskill.skill.spec import SkillSpec
from geoskill.training.error_changes import error_changes, fit_reward_scale

MEMBER = "p2p_sift"


def demonstration_of(frames: tuple[np.ndarray, ...], spec: SkillSpec, gap: int = 2) -> Demonstration:
    components = build_skill(spec)
    return Demonstration(
        frames,
        components.pipelines,
        components.members,
        gap=gap,
        max_span_ratio=0.6,
        num_negatives=0,
        progress=lambda items, text: items,
    )


@pytest.fixture(scope="module")
def singles(demonstration_frames: tuple[np.ndarray, ...], spec: SkillSpec) -> list[Demonstration]:
    """A short one, spans of 2 and 4, and a long one, spans of 2, 4 and 8; the long one begins with the short one."""
    return [
        demonstration_of(demonstration_frames[:8], spec),
        demonstration_of(demonstration_frames, spec),
    ]


@pytest.fixture(scope="module")
def both(singles: list[Demonstration]) -> Demonstrations:
    return Demonstrations(singles)


def test_demonstrations_have_the_spans_of_the_longest(singles: list[Demonstration], both: Demonstrations) -> None:
    assert [single.spans for single in singles] == [(2, 4), (2, 4, 8)]
    assert both.spans == (2, 4, 8)


def test_demonstrations_hold_every_transition_once_in_order(singles: list[Demonstration], both: Demonstrations) -> None:
    assert len(both) == (6 + 4) + (18 + 16 + 12)
    own = [(single, index) for single in singles for index in range(len(single))]
    for number, (single, index) in enumerate(own):
        expected, transition = single[index][MEMBER], both[number][MEMBER]
        for which in ("first", "second"):
            assert torch.equal(transition[which].point_geometry, expected[which].point_geometry)
            assert torch.equal(transition[which].point_next_geometry, expected[which].point_next_geometry)
            assert torch.equal(transition[which].span_index, expected[which].span_index)
        assert torch.equal(
            both.graph_without_negatives(MEMBER, number).point_next_geometry,
            single.graph_without_negatives(MEMBER, index).point_next_geometry,
        )


@pytest.mark.parametrize("index", [-1, 56])
def test_demonstrations_reject_index_out_of_range(both: Demonstrations, index: int) -> None:
    with pytest.raises(IndexError, match=rf"^transition {index}; expected 0 to 55$"):
        both[index]


def test_demonstrations_frames_and_descriptors(singles: list[Demonstration], both: Demonstrations) -> None:
    frames = list(both.frames(MEMBER))
    assert len(frames) == 28
    descriptors = both.descriptors(MEMBER)[NodeType.POINT]
    assert torch.equal(descriptors, torch.cat([frame.point_descriptor for frame in frames]))


def test_reward_scale_of_several_demonstrations(both: Demonstrations, spec: SkillSpec) -> None:
    members = {MEMBER: build_skill(spec).members[MEMBER]}
    objective = ObjectiveConfig()
    fit_reward_scale(members, both, objective)
    for span, beta in enumerate(members[MEMBER].beta):
        graphs = [
            graph
            for graph in (both.graph_without_negatives(MEMBER, i) for i in range(len(both)))
            if graph.span_index == span
        ]
        changes = [error_changes(members[MEMBER], graph, objective.change) for graph in graphs]
        moved = [error_changes(members[MEMBER], graph, "absolute").abs() > 1.0 for graph in graphs]
        assert beta == beta_from_changes(torch.cat(changes), torch.cat(moved), objective.beta_scale)


def test_demonstrations_reject_none_and_different_gaps(
    singles: list[Demonstration], demonstration_frames: tuple[np.ndarray, ...], spec: SkillSpec
) -> None:
    with pytest.raises(ValueError, match="no demonstration; expected at least one"):
        Demonstrations([])
    other_gap = demonstration_of(demonstration_frames, spec, gap=3)
    with pytest.raises(ValueError, match="expected the same gap"):
        Demonstrations([singles[0], other_gap])
