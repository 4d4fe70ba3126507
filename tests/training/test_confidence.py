"""The usual lead of a whole demonstration, and what a finished skill makes of it."""

from typing import Any

import pytest
import torch

from geoskill.training.confidence import fit_usual_lead

Training = Any


def test_it_is_the_median_over_the_frames(training: Training) -> None:
    demonstration, members = training.demonstration, training.members()
    fit_usual_lead(members, demonstration)
    for name, member in members.items():
        expected = []
        for t in range(demonstration.frame_count):
            with torch.no_grad():
                scores = member(demonstration.frame(name, t))
            expected.append(float(scores.max() - scores.mean()))
        assert float(member.usual_lead) == pytest.approx(torch.tensor(expected).median().item())
        assert not member.usual_lead.requires_grad
