"""Tests of the scored instances of an untrained skill."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from geoskill.skill.scored_frame import ScoredFrame, ScoredInstances
from geoskill.skill.skill import Skill


@pytest.fixture
def scored_frame(skill_file: Path, demonstration_frames: Sequence[np.ndarray]) -> ScoredFrame:
    return Skill.load(skill_file).observe(demonstration_frames[6])


@pytest.fixture
def points(scored_frame: ScoredFrame) -> ScoredInstances:
    return scored_frame.members["p2p_sift"]


def test_associations_carry_the_name_of_their_member(points: ScoredInstances) -> None:
    (association,) = replace(points, name="mine").associations([0])
    assert (association.member, association.kernel, association.descriptor) == ("mine", "p2p", "sift")


def test_penalized_subtracts_from_some_scores(points: ScoredInstances) -> None:
    mask = torch.arange(len(points)) < 2
    penalized = points.penalized(mask, 0.5)
    torch.testing.assert_close(points.scores - penalized.scores, 0.5 * mask)
    torch.testing.assert_close(penalized.select_out, torch.softmax(penalized.scores, dim=0))
    assert penalized.score_std != points.score_std == pytest.approx(float(points.scores.std(correction=0)))


def test_find_takes_equivalent_orders(scored_frame: ScoredFrame) -> None:
    points, mixed = scored_frame.members.values()
    first, second = points.graph.instance_index[:, 3].tolist()
    assert points.find([first, second]) == points.find([second, first]) == 3
    assert points.find([first, first]) is None
    assert mixed.find(mixed.graph.instance_index[:, 3].tolist()) == 3


def test_result_gives_a_reason_for_members_without_association(scored_frame: ScoredFrame) -> None:
    selected = {"p2p_sift": scored_frame.members["p2p_sift"].associations([0]), "p2l_sift_lbd": []}
    result = scored_frame.result(selected)
    assert result.associations == tuple(selected["p2p_sift"])
    counts = [len(scored_frame.features[name]) for name in ("sift", "lbd")]
    assert result.reasons == {"p2l_sift_lbd": f"no instance: {counts[0]} points, {counts[1]} lines found"}
