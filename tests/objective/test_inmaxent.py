"""The objective of a batch of transitions, put together by hand."""

import math
from dataclasses import replace
from typing import Any

import pytest
import torch
from torch import Tensor

from geoskill.config import ObjectiveConfig
from geoskill.errors import InputError
from geoskill.objective.goal import INFORMATIVE_PROGRESS
from geoskill.objective.inmaxent import FrameSelection, transition_objective
from geoskill.objective.partition import log_partition
from geoskill.objective.selection import select_out
from geoskill.schema import as_written


def without_goal(**values: Any) -> ObjectiveConfig:
    """The paper's objective, which has no goal term."""
    return ObjectiveConfig(goal_weight=0.0, **values)


def two_frames(
    weights: list[float], errors: list[list[float]], change: list[float], frames: list[int]
) -> FrameSelection:
    return FrameSelection(
        select_out=torch.tensor(weights, dtype=torch.float64),
        errors=torch.tensor(errors, dtype=torch.float64).reshape(-1, 2),
        change=torch.tensor(change, dtype=torch.float64),
        batch=torch.tensor(frames, dtype=torch.long),
        num_frames=2,
    )


# Transition 0: sum g delta = 0.75 · -4 + 0.25 · 2 = -2.5 and 1 · -3 = -3; norm(Ec) 0.75 · 5 + 0.25 · 10 = 6.25 -> 2.
# Transition 1: 0.5 · 1 + 0.5 · 0 = 0.5 and 0.5 · 0 + 0.5 · -1 = -0.5; norm(Ec) 4 -> 7.
FIRST = two_frames([0.75, 0.25, 0.5, 0.5], [[3, 4], [6, 8], [4, 0], [0, -4]], [-4, 2, 1, 0], [0, 0, 1, 1])
SECOND = two_frames([1.0, 0.5, 0.5], [[0, 2], [6, 0], [0, 8]], [-3, 0, -1], [0, 1, 1])


def likelihood(change: float, beta: float, sigma0: float) -> float:
    r = -math.tanh(beta * change / 2)
    return r - float(log_partition(torch.tensor(r, dtype=torch.float64), sigma0))


def test_tracked_objective_by_hand() -> None:
    settings = without_goal(top_k=1, rsw_weight=0.2)
    value = transition_objective(settings, 0.6, FIRST, SECOND)
    changes = [-2.5, 0.5, -3.0, -0.5]
    assert float(value.reward) == pytest.approx(sum(-math.tanh(0.3 * c) for c in changes) / 4)
    assert float(value.rsw) == pytest.approx((0.25 + 0.5 + 0.0 + 0.5) / 4)
    assert float(value.error) == pytest.approx((6.25 + 4 + 2 + 7) / 4)
    expected = sum(likelihood(c, 0.6, 0.55) for c in changes) / 4 - 0.2 * 1.25 / 4
    assert float(value.objective) == pytest.approx(expected, abs=1e-12)


def test_goal_term_by_hand() -> None:
    """q is uniform in three frames; in the fourth, the first of transition 1, it is 0.2 and 0.8."""
    goal_progress = torch.tensor([0.3, 0.3, 0.0, 0.1 * math.log(4)], dtype=torch.float64)
    first = replace(FIRST, goal_progress=goal_progress, scores=20 * FIRST.select_out.log())
    second = replace(SECOND, goal_progress=torch.zeros(3, dtype=torch.float64), scores=20 * SECOND.select_out.log())
    settings = ObjectiveConfig(goal_weight=0.5, goal_temperature=0.1, goal_scale=200.0)
    value = transition_objective(settings, 0.6, first, second)
    by_frame = [
        0.5 * math.log(0.5 / 0.75) + 0.5 * math.log(0.5 / 0.25),
        0.2 * math.log(0.2 / 0.5) + 0.8 * math.log(0.8 / 0.5),
        0.0,
        0.0,
    ]
    assert float(value.goal) == pytest.approx(sum(by_frame) / 4)
    weighed = transition_objective(settings, 0.6, replace(first, by_progress=torch.tensor([True, True])), second)
    weight = 0.8 * 0.1 * math.log(4) / INFORMATIVE_PROGRESS
    assert float(weighed.goal) == pytest.approx((by_frame[0] + weight * by_frame[1]) / 4)
    without = transition_objective(without_goal(), 0.6, first, second)
    assert float(without.goal) == 0
    assert float(value.objective) == pytest.approx(float(without.objective) - 0.5 * sum(by_frame) / 4)


@pytest.mark.usefixtures("annotations_unchecked")
def test_objective_with_goal_rejects_selections_without_progress() -> None:
    with pytest.raises(ValueError, match=r"without goal_progress or scores; expected both for goal_weight=1\.0$"):
        transition_objective(ObjectiveConfig(), 0.6, FIRST, SECOND)
    with pytest.raises(ValueError, match="goal_progress has 2 rows for 4 instances; expected as many"):
        replace(FIRST, goal_progress=torch.zeros(2, dtype=torch.float64))


def test_frame_objective_by_hand() -> None:
    settings = without_goal(reward="frame", sigma0=0.3)
    value = transition_objective(settings, 0.6, FIRST, SECOND)
    changes = [2 - 6.25, 7 - 4]
    assert float(value.reward) == pytest.approx(sum(-math.tanh(0.3 * c) for c in changes) / 2)
    assert float(value.rsw) == 0.0, "no frame has more than ten instances"
    assert float(value.objective) == pytest.approx(sum(likelihood(c, 0.6, 0.3) for c in changes) / 2, abs=1e-12)


def test_frame_objective_with_the_literal_vector_sum() -> None:
    settings = without_goal(reward="frame", error_reduction="vector")
    value = transition_objective(settings, 0.6, FIRST, SECOND)
    # Ec: 0.75 (3, 4) + 0.25 (6, 8), (2, -2), (0, 2), (3, 4)
    assert float(value.error) == pytest.approx((6.25 + math.sqrt(8) + 2 + 5) / 4)
    changes = [2 - 6.25, 5 - math.sqrt(8)]
    assert float(value.reward) == pytest.approx(sum(-math.tanh(0.3 * c) for c in changes) / 2)


def test_objective_rises_with_the_weight_of_an_approaching_instance() -> None:
    scores = torch.zeros(2, dtype=torch.float64, requires_grad=True)
    batch = torch.zeros(2, dtype=torch.long)
    frames = FrameSelection(
        select_out(scores, batch, 1),
        torch.tensor([[30.0, 0.0], [30.0, 0.0]], dtype=torch.float64),
        torch.tensor([-5.0, 5.0], dtype=torch.float64),
        batch,
        1,
    )
    transition_objective(without_goal(), 0.3, frames, frames).objective.backward()
    assert scores.grad is not None
    assert float(scores.grad[0]) > 0 > float(scores.grad[1])


def test_rsw_alone_sharpens_the_selection() -> None:
    scores = torch.tensor([1.0, 0.0, -1.0], dtype=torch.float64, requires_grad=True)
    batch = torch.zeros(3, dtype=torch.long)
    zero = torch.zeros(3, dtype=torch.float64)
    frames = FrameSelection(select_out(scores, batch, 1), zero[:, None], zero, batch, 1)
    transition_objective(without_goal(top_k=1), 1.0, frames, frames).objective.backward()
    assert scores.grad is not None
    assert float(scores.grad[0]) > 0 > float(scores.grad[1])


def one_by_one(frames: FrameSelection, frame: int) -> FrameSelection:
    rows = frames.batch == frame
    return FrameSelection(
        frames.select_out[rows], frames.errors[rows], frames.change[rows], frames.batch[rows] * 0, num_frames=1
    )


def ragged(counts: list[int], seed: int) -> FrameSelection:
    generator = torch.Generator().manual_seed(seed)
    batch = torch.arange(len(counts)).repeat_interleave(torch.tensor(counts))
    m = len(batch)
    scores = torch.randn(m, generator=generator, dtype=torch.float64)
    return FrameSelection(
        select_out(scores, batch, len(counts)),
        10 * torch.randn(m, 2, generator=generator, dtype=torch.float64),
        4 * torch.randn(m, generator=generator, dtype=torch.float64),
        batch,
        len(counts),
    )


@pytest.mark.parametrize("reward", ["tracked", "frame"])
def test_objective_of_a_batch_is_the_mean_of_its_transitions(reward: Any) -> None:
    first, second = ragged([3, 0, 7, 1, 0], seed=0), ragged([2, 5, 4, 0, 0], seed=1)
    settings = without_goal(reward=reward, top_k=2)
    batched = transition_objective(settings, 0.4, first, second)
    single = [transition_objective(settings, 0.4, one_by_one(first, i), one_by_one(second, i)) for i in range(5)]
    for key in ("objective", "reward", "rsw", "error"):
        torch.testing.assert_close(getattr(batched, key), torch.stack([getattr(v, key) for v in single]).mean())


def test_frame_objective_of_an_empty_frame() -> None:
    first, second = ragged([3], seed=0), ragged([0], seed=1)
    value = transition_objective(without_goal(reward="frame"), 0.4, first, second)
    assert float(value.reward) == 0.0
    assert float(transition_objective(without_goal(reward="frame"), 0.4, second, first).reward) == 0.0


def test_monte_carlo_objective_approaches_the_exact_one_and_repeats_with_the_seed() -> None:
    exact = transition_objective(without_goal(), 0.6, FIRST, SECOND).objective
    settings = without_goal(partition="monte_carlo", value_samples=20000, gradient_samples=10)
    estimates = [
        transition_objective(settings, 0.6, FIRST, SECOND, torch.Generator().manual_seed(5)).objective for _ in range(2)
    ]
    # exp(x) has a relative standard deviation below 0.5, and four rewards are averaged
    assert float(estimates[0]) == pytest.approx(float(exact), abs=4 * 0.5 / math.sqrt(4 * 20000))
    assert torch.equal(*estimates)


@pytest.mark.parametrize("reward", ["tracked", "frame"])
@pytest.mark.parametrize("error_reduction", ["norm", "vector"])
def test_objective_gradients(reward: Any, error_reduction: Any) -> None:
    settings = without_goal(reward=reward, error_reduction=error_reduction, top_k=2)
    template = ragged([3, 4], seed=3), ragged([5, 2], seed=4)

    def objective(first_scores: Tensor, second_scores: Tensor) -> Tensor:
        first, second = (
            FrameSelection(select_out(s, t.batch, 2), t.errors, t.change, t.batch, 2)
            for s, t in zip((first_scores, second_scores), template, strict=True)
        )
        return transition_objective(settings, 0.3, first, second).objective

    generator = torch.Generator().manual_seed(9)
    scores = tuple(torch.randn(7, generator=generator, dtype=torch.float64, requires_grad=True) for _ in range(2))
    assert torch.autograd.gradcheck(objective, scores)


def test_objective_keeps_float32() -> None:
    frames = ragged([3, 2], seed=0)
    single = FrameSelection(
        frames.select_out.float(), frames.errors.float(), frames.change.float(), frames.batch, frames.num_frames
    )
    partition: Any
    for partition in ("exact", "monte_carlo"):
        value = transition_objective(without_goal(partition=partition), 0.4, single, single)
        assert {value.objective.dtype, value.reward.dtype, value.rsw.dtype, value.error.dtype} == {torch.float32}
        assert value.objective.shape == ()


def test_objective_settings_defaults() -> None:
    settings = ObjectiveConfig()
    assert (settings.sigma0, settings.rsw_weight, settings.top_k, settings.beta_scale) == (0.55, 0.1, 10, 1.5)
    assert (settings.goal_weight, settings.goal_temperature, settings.goal_scale) == (1.0, 0.1, 200.0)
    assert (settings.reward, settings.error_reduction, settings.partition) == ("tracked", "norm", "exact")


@pytest.mark.usefixtures("annotations_unchecked")
@pytest.mark.parametrize(
    ("key", "value", "expected"),
    [
        ("sigma0", 0.0, "a number of at least 0.001 and at most 1000"),
        ("sigma0", 5e3, "a number of at least 0.001 and at most 1000"),
        ("sigma0", math.nan, "a number of at least 0.001 and at most 1000"),
        ("sigma0", "wide", "a number of at least 0.001 and at most 1000"),
        ("sigma0", None, "a number of at least 0.001 and at most 1000"),
        ("rsw_weight", -0.1, "a number of at least 0"),
        ("rsw_weight", math.inf, "a number of at least 0"),
        ("top_k", 0, "a whole number of at least 1"),
        ("top_k", 2.5, "a whole number of at least 1"),
        ("top_k", True, "a whole number of at least 1"),
        ("value_samples", 0, "a whole number of at least 1"),
        ("gradient_samples", -3, "a whole number of at least 1"),
        ("beta_scale", 0.0, "a number above 0"),
        ("beta_scale", math.nan, "a number above 0"),
        ("goal_weight", -1.0, "a number of at least 0"),
        ("goal_temperature", 0.0, "a number above 0"),
        ("goal_temperature", [0.1], "a number above 0"),
        ("goal_scale", math.inf, "a number above 0"),
        ("reward", "both", "tracked or frame"),
        ("error_reduction", "sum", "norm or vector"),
        ("partition", "closed", "exact or monte_carlo"),
        ("partition", ["exact"], "exact or monte_carlo"),
    ],
)
def test_objective_settings_reject_bad_values(key: str, value: Any, expected: str) -> None:
    with pytest.raises(InputError) as error:
        ObjectiveConfig(**{key: value})
    assert str(error.value) == f"{key}={as_written(value)}: expected {expected}"


@pytest.mark.usefixtures("annotations_unchecked")
def test_frame_selection_rejects_wrong_lengths() -> None:
    with pytest.raises(ValueError, match=r"\(1, 1, 2, 1\) rows; expected the same number"):
        FrameSelection(torch.ones(1), torch.ones(1, 2), torch.ones(2), torch.zeros(1, dtype=torch.long), 1)
    with pytest.raises(ValueError, match="num_frames=0: expected at least 1"):
        FrameSelection(torch.ones(0), torch.ones(0, 2), torch.ones(0), torch.zeros(0, dtype=torch.long), 0)
    with pytest.raises(ValueError, match="2 earlier and 1 later frames"):
        transition_objective(without_goal(), 1.0, FIRST, one_by_one(SECOND, 0))
