"""Reward, changes, overall control error and beta."""

import math

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch import Tensor

from geoskill.errors import InputError
from geoskill.objective.reward import (
    beta_from_changes,
    error_change,
    overall_error,
    reward,
    tracked_change,
)

BATCH = torch.tensor([0, 0, 0, 2, 2, 3])  # frames 1 and 4 have no instance
SELECT_OUT = torch.tensor([0.5, 0.25, 0.25, 0.125, 0.875, 1.0])
FRAMES = 5


@settings(max_examples=60, deadline=None)
@given(st.floats(-50, 50), st.floats(0.01, 5))
def test_reward_is_equation_7(change: float, beta: float) -> None:
    literal = 2 / (1 + math.exp(beta * change)) - 1
    assert float(reward(torch.tensor(change, dtype=torch.float64), beta)) == pytest.approx(literal, abs=1e-14)


def test_reward_is_positive_for_a_decrease_and_saturates_without_overflow() -> None:
    change = torch.tensor([-1e30, -2.0, 0.0, 2.0, 1e30], requires_grad=True)
    value = reward(change, beta=1.0)
    value.sum().backward()
    torch.testing.assert_close(value, torch.tensor([1.0, math.tanh(1), 0.0, -math.tanh(1), -1.0]))
    assert change.grad is not None
    assert change.grad[[0, 4]].tolist() == [0.0, 0.0]
    assert float(change.grad[2]) == -0.5, "slope -beta/2 at zero"


def test_tracked_change_of_ragged_frames() -> None:
    change = torch.tensor([-8.0, 4.0, 0.0, 16.0, 0.0, -3.0])
    assert tracked_change(SELECT_OUT, change, BATCH, FRAMES).tolist() == [-3.0, 0.0, 2.0, -3.0, 0.0]


def test_overall_error_of_ragged_frames() -> None:
    errors = torch.tensor([[3.0, 4.0], [-6.0, -8.0], [0.0, 0.0], [8.0, 0.0], [0.0, 8.0], [5.0, 12.0]])
    assert overall_error(SELECT_OUT, errors, BATCH, FRAMES, "norm").tolist() == [5.0, 0.0, 8.0, 13.0, 0.0]
    vector = overall_error(SELECT_OUT, errors, BATCH, FRAMES, "vector")
    torch.testing.assert_close(vector, torch.tensor([0.0, 0.0, math.sqrt(50), 13.0, 0.0]))


@pytest.mark.parametrize("reduction", ["norm", "vector"])
def test_overall_error_of_a_batch_equals_the_frames_one_by_one(reduction: str) -> None:
    generator = torch.Generator().manual_seed(0)
    batch = torch.arange(7).repeat_interleave(torch.tensor([3, 0, 5, 1, 0, 8, 2]))
    weights, errors = torch.rand(19, generator=generator), torch.randn(19, 2, generator=generator)
    loop = [
        overall_error(weights[batch == f], errors[batch == f], batch[batch == f] * 0, 1, reduction) for f in range(7)
    ]
    batched = overall_error(weights, errors, batch, 7, reduction)
    torch.testing.assert_close(batched, torch.cat(loop))


@pytest.mark.parametrize("reduction", ["norm", "vector"])
def test_overall_error_has_a_finite_gradient_where_errors_vanish(reduction: str) -> None:
    weights, errors = SELECT_OUT.clone().requires_grad_(), torch.zeros(6, 2, requires_grad=True)
    overall_error(weights, errors, BATCH, FRAMES, reduction).sum().backward()
    assert weights.grad is not None
    assert weights.grad.tolist() == [0.0] * 6
    assert errors.grad is not None
    assert bool(errors.grad.isfinite().all())


@pytest.mark.usefixtures("annotations_unchecked")
def test_overall_error_rejects_unknown_reduction() -> None:
    with pytest.raises(InputError, match=r"^reduction=sum: expected one of norm, vector$"):
        overall_error(SELECT_OUT, torch.zeros(6, 2), BATCH, FRAMES, "sum")  # type: ignore[arg-type]


def test_reward_and_error_gradients() -> None:
    generator = torch.Generator().manual_seed(0)
    weights = torch.rand(6, generator=generator, dtype=torch.float64, requires_grad=True)
    change = torch.randn(6, generator=generator, dtype=torch.float64, requires_grad=True)
    errors = torch.randn(6, 2, generator=generator, dtype=torch.float64, requires_grad=True)
    assert torch.autograd.gradcheck(lambda c: reward(c, 0.7), (change,))
    assert torch.autograd.gradcheck(lambda g, c: tracked_change(g, c, BATCH, FRAMES), (weights, change))
    assert torch.autograd.gradcheck(lambda g, e: overall_error(g, e, BATCH, FRAMES, "norm"), (weights, errors))

    def of_filled_frames(g: Tensor, e: Tensor) -> Tensor:
        return overall_error(g, e, BATCH, FRAMES, "vector")[[0, 2, 3]]

    assert torch.autograd.gradcheck(of_filled_frames, (weights, errors))


def moving(changes: list[float], resolution: float = 1.0) -> tuple[Tensor, Tensor]:
    values = torch.tensor(changes)
    return values, values.abs() > resolution


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ([0.5, -2.0, 4.0, 0.0], 1.5 / 3),  # an even number of moving instances: the mean of the middle two
        ([-2.0, 100.0, 3.0, 0.1, -0.9], 1.5 / 3),  # an odd number
        ([1.0, -1.0, 1.5], 1.0),  # 1 px exactly is not a move
        ([0.2, -0.9], 0.0),  # nothing moves: no reward
        ([], 0.0),
    ],
)
def test_beta_is_the_scale_over_the_median_move(changes: list[float], expected: float) -> None:
    assert float(beta_from_changes(*moving(changes))) == pytest.approx(expected)


def test_beta_with_another_scale() -> None:
    assert float(beta_from_changes(*moving([0.25, 0.5, -0.75], 0.3), scale=3.0)) == pytest.approx(3.0 / 0.625)


def test_beta_makes_the_median_change_earn_tanh_of_half_the_scale() -> None:
    changes, moves = moving([-2.0, -7.0, -30.0])
    assert float(reward(changes, beta_from_changes(changes, moves))[1]) == pytest.approx(math.tanh(0.75))


def test_absolute_change_is_the_difference() -> None:
    before, after = torch.tensor([10.0, 3.0]), torch.tensor([4.0, 5.0])
    assert error_change(before, after, "absolute", 1.0).tolist() == [-6.0, 2.0]


@settings(max_examples=60, deadline=None)
@given(st.floats(0, 500), st.floats(0, 500), st.floats(0.01, 5))
def test_relative_change_is_bounded_antisymmetric_and_without_unit(before: float, after: float, unit: float) -> None:
    first, second = torch.tensor([before], dtype=torch.float64), torch.tensor([after], dtype=torch.float64)
    change = error_change(first, second, "relative", 1.0)
    assert abs(float(change)) < 1
    assert float(error_change(second, first, "relative", 1.0)) == -float(change)
    scaled = error_change(unit * first, unit * second, "relative", unit)
    torch.testing.assert_close(scaled, change)


def test_relative_change_is_larger_for_a_smaller_final_error() -> None:
    near, far = error_change(torch.tensor([100.0, 150.0]), torch.tensor([10.0, 60.0]), "relative", 1.0)
    assert float(near) == pytest.approx(-90 / 114)
    assert float(far) == pytest.approx(-90 / 214)


def test_error_change_rejects_unknown_change(annotations_unchecked: None) -> None:
    with pytest.raises(InputError, match=r"^change=log: expected one of relative, absolute$"):
        error_change(torch.ones(1), torch.ones(1), "log", 1.0)  # type: ignore[arg-type]
