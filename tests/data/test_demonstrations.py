"""Several demonstrations as one: every transition of each is there once, under the right span."""

import numpy as np
import pytest
import torch

from geoskill.config import ObjectiveConfig
from geoskill.data.demonstration import Demonstration
from geoskill.data.demonstrations import Demonstrations
from geoskill.geometry.primitives import NodeType
from geoskill.objective.reward import beta_from_changes
from geoskill.skill.spec import SkillSpec, build_skill
from geoskill.training.error_changes import error_changes, fit_reward_scale

MEMBER = "p2p_sift"


def demonstration_of(frames: tuple[np.ndarray, ...], spec: SkillSpec, gap: int = 2) -> Demonstration:
    parts = build_skill(spec)
    return Demonstration(
        frames,
        parts.pipelines,
        parts.members,
        gap=gap,
        horizon=0.6,
        num_negatives=0,
        progress=lambda items, text: items,
    )


@pytest.fixture(scope="module")
def parts(demonstration_frames: tuple[np.ndarray, ...], spec: SkillSpec) -> list[Demonstration]:
    """A short one, spans of 2 and 4, and a long one, spans of 2, 4 and 8; the long one begins with the short one."""
    return [
        demonstration_of(demonstration_frames[:8], spec),
        demonstration_of(demonstration_frames, spec),
    ]


@pytest.fixture(scope="module")
def both(parts: list[Demonstration]) -> Demonstrations:
    return Demonstrations(parts)


def test_spans_are_those_of_the_longest(parts: list[Demonstration], both: Demonstrations) -> None:
    assert [part.spans for part in parts] == [(2, 4), (2, 4, 8)]
    assert both.spans == (2, 4, 8)


def test_every_transition_is_there_once_in_order(parts: list[Demonstration], both: Demonstrations) -> None:
    assert len(both) == (6 + 4) + (18 + 16 + 12)
    own = [(part, index) for part in parts for index in range(len(part))]
    for number, (part, index) in enumerate(own):
        expected, found = part[index][MEMBER], both[number][MEMBER]
        for which in ("first", "second"):
            assert torch.equal(found[which].point_geometry, expected[which].point_geometry)
            assert torch.equal(found[which].point_next_geometry, expected[which].point_next_geometry)
            assert torch.equal(found[which].span_index, expected[which].span_index)
        assert torch.equal(
            both.graph_without_negatives(MEMBER, number).point_next_geometry,
            part.graph_without_negatives(MEMBER, index).point_next_geometry,
        )


@pytest.mark.parametrize("index", [-1, 56])
def test_no_transition_has_this_number(both: Demonstrations, index: int) -> None:
    with pytest.raises(IndexError, match=rf"^transition {index}; expected 0 to 55$"):
        both[index]


def test_frames_and_descriptors_of_all(parts: list[Demonstration], both: Demonstrations) -> None:
    frames = list(both.frames(MEMBER))
    assert len(frames) == 28
    descriptors = both.descriptors(MEMBER)[NodeType.POINT]
    assert torch.equal(descriptors, torch.cat([frame.point_descriptor for frame in frames]))


def test_the_reward_scale_is_that_of_all_transitions(both: Demonstrations, spec: SkillSpec) -> None:
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


def test_none_or_of_different_gaps(
    parts: list[Demonstration], demonstration_frames: tuple[np.ndarray, ...], spec: SkillSpec
) -> None:
    with pytest.raises(ValueError, match="no demonstration; expected at least one"):
        Demonstrations([])
    other = demonstration_of(demonstration_frames, spec, gap=3)
    with pytest.raises(ValueError, match="expected the same gap"):
        Demonstrations([parts[0], other])
