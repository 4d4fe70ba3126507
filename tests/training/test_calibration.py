"""The reference margin of the confidence, fitted to a demonstration."""

from typing import Any

import pytest
import torch

from geoskill.model.confidence import score_margins
from geoskill.training.calibration import fit_reference_margin

Training = Any


def test_reference_margin_and_level_are_medians_over_the_frames(training: Training) -> None:
    demonstration, members = training.demonstration, training.members()
    fit_reference_margin(members, demonstration)
    for name, member in members.items():
        expected, means = [], []
        for graph in demonstration.frames(name):
            with torch.no_grad():
                scores = member(graph)
            expected.append(float(scores.max() - scores.mean()))
            means.append(float(scores.mean()))
        assert float(member.reference_margin) == pytest.approx(torch.tensor(expected).median().item())
        assert float(member.reference_level) == pytest.approx(torch.tensor(means).median().item())
        assert not member.reference_margin.requires_grad


def test_reference_margin_is_of_the_scores_that_a_skill_uses(training: Training) -> None:
    """Scores of more instances than a cascade takes are partly estimates."""
    model = {"name": "message_passing", "hidden_dim": 8, "layers": 2, "encoder_dim": None, "prototypes": None}
    members = training.members({**model, "cascade": 3})
    name, member = next(iter(members.items()))
    fit_reference_margin(members, training.demonstration)
    graphs = list(training.demonstration.frames(name))
    assert len(graphs) == training.demonstration.frame_count
    assert all(graph.instance_index.shape[1] > 3 for graph in graphs)
    with torch.no_grad():
        used = torch.stack([score_margins(member.eval()(graph)).max() for graph in graphs]).median()
        exact = torch.stack([score_margins(member.train()(graph)).max() for graph in graphs]).median()
    assert float(member.reference_margin) == pytest.approx(float(used))
    assert float(used) != pytest.approx(float(exact))
