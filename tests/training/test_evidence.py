"""Whether what a member selects came together in the demonstration."""

from typing import Any

import pytest
import torch

from geoskill.training.error_changes import errors_at_ends, instance_goal_progress
from geoskill.training.evidence import MUCH_PROGRESS, SOME_PROGRESS, fit_evidence
from geoskill.training.selected_frames import first_demonstration

Training = Any
NAME = "p2p_sift"


def with_scores(training: Training, monkeypatch: pytest.MonkeyPatch, sign: float) -> Any:
    """Return a member that selects what makes the most progress, or the least."""
    members = training.members()
    member = members[NAME]
    monkeypatch.setattr(type(member), "forward", lambda self, graph: sign * instance_goal_progress(self, graph))
    fit_evidence(member, first_demonstration(NAME, training.demonstration))
    return member


def test_evidence_of_the_best_selection(training: Training, monkeypatch: pytest.MonkeyPatch) -> None:
    member = with_scores(training, monkeypatch, 1.0)
    best, some, ratios = [], [], []
    for graph in first_demonstration(NAME, training.demonstration):
        progress = instance_goal_progress(member, graph)
        before, after = errors_at_ends(member, graph)
        row = int(progress.argmax())
        best.append(float(progress[row]))
        some.append(float((progress >= SOME_PROGRESS).sum()))
        ratios += [float(after[row] / before[row])] if best[-1] >= MUCH_PROGRESS else []
    assert member.evidence is not None
    share = sum(value >= MUCH_PROGRESS for value in best) / len(best)
    assert member.evidence.approached == pytest.approx(share)
    assert member.evidence.found, "the demonstration brings two things together"
    assert member.evidence.end_over_start == pytest.approx(float(torch.tensor(ratios).median()))
    assert member.evidence.approaching == pytest.approx(float(torch.tensor(some).median()))


def test_evidence_of_the_worst_selection(training: Training, monkeypatch: pytest.MonkeyPatch) -> None:
    evidence = with_scores(training, monkeypatch, -1.0).evidence
    assert (evidence.approached, evidence.end_over_start, evidence.found) == (0.0, 1.0, False)


def test_evidence_is_kept_in_the_state_of_a_member(training: Training) -> None:
    members = training.members()
    assert members[NAME].evidence is None
    fit_evidence(members[NAME], first_demonstration(NAME, training.demonstration))
    fresh = training.members()
    fresh[NAME].load_state_dict(members[NAME].state_dict())
    assert fresh[NAME].evidence == members[NAME].evidence is not None
