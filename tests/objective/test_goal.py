"""The goal term by hand, and the selections that it prefers."""

import math

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from geoskill.objective.goal import INFORMATIVE_PROGRESS, goal_divergence, goal_progress

ERRORS = st.floats(0.0, 1e4)


def progress(before: float, after: float, known: bool = True, resolution: float = 1.0) -> float:
    values = torch.tensor([before], dtype=torch.float64), torch.tensor([after], dtype=torch.float64)
    return float(goal_progress(*values, torch.tensor([known]), resolution))


def test_goal_progress_by_hand() -> None:
    assert progress(60, 4) == pytest.approx(math.log(64 / 8) / (1 + math.log(64 / 4)))
    assert progress(30, 2, resolution=0.5) == progress(60, 4), "errors count in units of the resolution"


def test_goal_progress_is_zero_when_the_end_is_unknown() -> None:
    assert progress(60, 0, known=False) == 0


@given(error=ERRORS)
def test_goal_progress_is_zero_without_change(error: float) -> None:
    assert progress(error, error) == pytest.approx(0, abs=1e-12)


@given(before=ERRORS, after=ERRORS)
def test_goal_progress_is_below_one_with_the_sign_of_the_approach(before: float, after: float) -> None:
    value = progress(before, after)
    assert value < 1
    assert math.copysign(1, value) == math.copysign(1, before - after) or value == pytest.approx(0, abs=1e-9)


@given(before=st.floats(10, 1e4), after=st.floats(0, 5), nearer=st.floats(0.1, 4.9))
def test_goal_progress_grows_with_a_smaller_final_error(before: float, after: float, nearer: float) -> None:
    assert progress(before, min(after, nearer) / 2) > progress(before, max(after, nearer))


def test_goal_progress_separates_a_neighbor_that_comes_as_much_closer() -> None:
    """From 200 px away, a box's corner comes within 2 px of a tile's corner and within 30 px of the next corner."""
    q = torch.softmax(torch.tensor([progress(200, 2), progress(228, 30)]) / 0.05, 0)
    assert float(q[0]) > 0.99


def divergence(scores: list[float], instance_progress: list[float], temperature: float, scale: float) -> float:
    b, a = torch.tensor(scores, dtype=torch.float64), torch.tensor(instance_progress, dtype=torch.float64)
    return float(goal_divergence(b, a, temperature, scale, torch.zeros(len(b), dtype=torch.long), 1))


def test_goal_divergence_by_hand() -> None:
    # Over a scale of 200 and a temperature of 0.1, g is 2/4, 1/4, 1/4; and a frame of one instance.
    b = torch.tensor([20 * math.log(2), 0.0, 0.0, 3.0], dtype=torch.float64)
    a = torch.tensor([0.1 * math.log(4), 0.0, 0.0, 0.7], dtype=torch.float64)
    q, g = [4 / 6, 1 / 6, 1 / 6], [0.5, 0.25, 0.25]
    expected = sum(q_i * math.log(q_i / g_i) for q_i, g_i in zip(q, g, strict=True))
    batch = torch.tensor([0, 0, 0, 2])
    values = goal_divergence(b, a, 0.1, 200.0, batch, num_frames=3)
    torch.testing.assert_close(values, torch.tensor([expected, 0.0, 0.0], dtype=torch.float64))
    weighed = goal_divergence(b, a, 0.1, 200.0, batch, 3, torch.tensor([True, True, False]))
    weight = q[0] * 0.1 * math.log(4) / INFORMATIVE_PROGRESS
    torch.testing.assert_close(weighed, torch.tensor([weight * expected, 0.0, 0.0], dtype=torch.float64))


@given(scores=st.lists(st.floats(-20, 20), min_size=1, max_size=6), shift=st.floats(-5, 5))
def test_goal_divergence_is_zero_for_scaled_progress(scores: list[float], shift: float) -> None:
    instance_progress = [0.5 * rank / len(scores) for rank in range(len(scores))]
    wanted = [200 * value + shift for value in instance_progress]
    for temperature in (0.05, 0.45):
        assert divergence(wanted, instance_progress, temperature, 200.0) == pytest.approx(0, abs=1e-9)
        assert divergence(scores, instance_progress, temperature, 200.0) >= -1e-12


def test_goal_divergence_counts_in_full_from_the_informative_progress_on() -> None:
    """The progress of the two is equal, so q is 1/2, 1/2, while g is 3/4, 1/4 over a scale of 10."""
    in_full = 0.5 * math.log(0.5 / 0.75) + 0.5 * math.log(0.5 / 0.25)
    for progress, share in ((0.9, 1.0), (INFORMATIVE_PROGRESS, 1.0), (INFORMATIVE_PROGRESS / 3, 1 / 3), (-0.5, 0.0)):
        b, a = (torch.tensor(values, dtype=torch.float64) for values in ([math.log(3), 0.0] * 2, [progress] * 4))
        values = goal_divergence(b, a, 0.1, 10.0, torch.tensor([0, 0, 1, 1]), 2, torch.tensor([True, False]))
        assert values.tolist() == pytest.approx([share * in_full, in_full])


def test_goal_divergence_depends_on_lower_ranks_at_high_temperature_only() -> None:
    """The scores order the worst three wrongly."""
    instance_progress, scores = [0.7, 0.3, 0.2, 0.1], [140.0, 20.0, 40.0, 60.0]
    assert divergence(scores, instance_progress, 0.02, 200.0) < 1e-3 < divergence(scores, instance_progress, 0.4, 200.0)


def test_goal_divergence_gradient() -> None:
    """d KL(q || softmax(b / c)) / db = (softmax(b / c) - q) / c, also for an instance with a very low score."""
    scores = torch.tensor([0.0, -60.0, 1.0], dtype=torch.float64, requires_grad=True)
    batch, a = torch.zeros(3, dtype=torch.long), torch.tensor([0.0, 0.5, 0.1], dtype=torch.float64)
    goal_divergence(scores, a, 0.05, 40.0, batch, 1).sum().backward()
    expected = (torch.softmax(scores / 2, 0) - torch.softmax(a / 0.05, 0)) / 2
    torch.testing.assert_close(scores.grad, expected.detach())


def test_goal_divergence_of_frames_without_instances() -> None:
    empty, frames = torch.zeros(0), torch.zeros(0, dtype=torch.long)
    assert goal_divergence(empty, empty, 0.1, 200.0, frames, 2).tolist() == [0.0, 0.0]
