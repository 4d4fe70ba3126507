"""The partition function: the table of docs/method.md, quadrature as a reference, extremes, Monte Carlo."""

import math

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import fixed_quad
from scipy.stats import truncnorm
from torch import Tensor

from geoskill.errors import InputError
from geoskill.objective.partition import (
    SIGMA0_RANGE,
    confidence_from_sigma0,
    log_partition,
    log_partition_monte_carlo,
    sample_truncated_normal,
    sigma0_from_confidence,
)

REWARDS = [-1.0, -0.999, -0.5, 0.0, 0.3, 0.9, 0.999, 1.0]
EXTREME_SIGMAS = [0.001, 0.01, 0.02, 3.0, 10.0, 100.0, 1000.0]
ALL_SIGMAS = [*EXTREME_SIGMAS, 0.1, 0.3, 0.55, 0.9, 1.0, 1.2, 1.5, 2.0]


def by_quadrature(reward: float, sigma0: float) -> tuple[float, float]:
    """log Z and d log Z / dr, from integrals of the definition: the slope is (E[x e^x]/E[e^x] - E[x]) / sigma0²."""
    # x = r + sigma0 t; further out than 12 standard deviations every integrand is below e^-72
    ends = max(-12.0, (-1 - reward) / sigma0), min(12.0 + sigma0, (1 - reward) / sigma0)

    def integral(weight: float, power: int) -> float:
        def integrand(t: np.ndarray) -> np.ndarray:
            return np.asarray(np.exp(-t * t / 2 + weight * sigma0 * t) * t**power)

        return float(fixed_quad(integrand, *ends, n=100)[0])

    mass, weighted = integral(0, 0), integral(1, 0)
    slope = (integral(1, 1) / weighted - integral(0, 1) / mass) / sigma0
    return reward + math.log(weighted / mass), slope


def value_and_slope(rewards: list[float], sigma0: float, dtype: torch.dtype) -> tuple[Tensor, Tensor]:
    r = torch.tensor(rewards, dtype=dtype, requires_grad=True)
    value = log_partition(r, sigma0)
    value.sum().backward()
    assert r.grad is not None
    return value.detach(), r.grad


def likelihood(rewards: list[float], sigma0: float) -> tuple[Tensor, Tensor]:
    """f = r - log Z and its slope."""
    value, slope = value_and_slope(rewards, sigma0, torch.float64)
    return torch.tensor(rewards, dtype=torch.float64) - value, 1 - slope


@pytest.mark.parametrize(
    ("sigma0", "lowest", "highest"),
    [
        (0.1, -0.0810, 0.0774),
        (0.3, -0.2561, 0.2233),
        (0.55, -0.4985, 0.3886),
        (1.0, -0.8573, 0.6091),
        (2.0, -1.0781, 0.7686),
    ],
)
def test_likelihood_at_the_ends_of_the_table(sigma0: float, lowest: float, highest: float) -> None:
    value, _ = likelihood([-0.999, 0.999], sigma0)
    assert [round(v, 4) for v in value.tolist()] == [lowest, highest]


@pytest.mark.parametrize(
    ("sigma0", "least", "most", "least_digits"),
    [
        (0.1, 0.0, 0.645, 3),
        (0.3, 0.0116, 0.667, 4),
        (0.55, 0.308, 0.692, 3),
        (1.0, 0.713, 0.787, 3),
        (2.0, 0.922, 0.928, 3),
    ],
)
def test_likelihood_slopes_of_the_table(sigma0: float, least: float, most: float, least_digits: int) -> None:
    # The table has the slopes at nine evenly spaced rewards; see the next test.
    _, slope = likelihood(torch.linspace(-0.999, 0.999, 9, dtype=torch.float64).tolist(), sigma0)
    assert round(float(slope.min()), least_digits) == least
    assert round(float(slope.max()), 3) == most


@pytest.mark.parametrize(("sigma0", "least"), [(0.3, 0.010606), (0.55, 0.302876), (1.0, 0.712546)])
def test_likelihood_least_slope_of_all_rewards(sigma0: float, least: float) -> None:
    # from the closed form in 40-digit arithmetic, on a grid of 0.004
    _, slope = likelihood(torch.linspace(-1, 1, 501, dtype=torch.float64).tolist(), sigma0)
    assert float(slope.min()) == pytest.approx(least, abs=2e-6)


@pytest.mark.parametrize("sigma0", ALL_SIGMAS)
def test_log_partition_agrees_with_quadrature(sigma0: float) -> None:
    reference = [by_quadrature(r, sigma0) for r in REWARDS]
    expected_value = torch.tensor([value for value, _ in reference], dtype=torch.float64)
    expected_slope = torch.tensor([slope for _, slope in reference], dtype=torch.float64)
    value, slope = value_and_slope(REWARDS, sigma0, torch.float64)
    torch.testing.assert_close(value, expected_value, rtol=0, atol=5e-15)
    # near r = ±1 the slope is a difference of two terms of size 1/sigma0; so is the quadrature's
    torch.testing.assert_close(slope, expected_slope, rtol=0, atol=max(1e-13, 2e-14 / sigma0))


@pytest.mark.parametrize("sigma0", ALL_SIGMAS)
def test_log_partition_float32_agrees_with_float64(sigma0: float) -> None:
    rewards = torch.tensor(REWARDS).tolist()  # the same rounded rewards for both
    value, slope = value_and_slope(rewards, sigma0, torch.float32)
    expected_value, expected_slope = value_and_slope(rewards, sigma0, torch.float64)
    assert value.dtype == torch.float32
    torch.testing.assert_close(value.double(), expected_value, rtol=0, atol=8e-7)
    torch.testing.assert_close(slope.double(), expected_slope, rtol=0, atol=max(1e-6, 4e-7 / sigma0))


@pytest.mark.parametrize("sigma0", [0.2, 0.55, 1.0, 1.3, 3.0])
def test_log_partition_gradients(sigma0: float) -> None:
    # the branches meet at r = 1 - sigma0²
    rewards = torch.tensor([-0.95, -0.2, 0.4, 0.99], dtype=torch.float64, requires_grad=True)
    assert torch.autograd.gradcheck(lambda r: log_partition(r, sigma0), (rewards,))
    assert torch.autograd.gradgradcheck(lambda r: log_partition(r, sigma0), (rewards,))


@pytest.mark.parametrize("sigma0", ALL_SIGMAS)
def test_log_partition_second_gradient_is_finite(sigma0: float) -> None:
    rewards = torch.tensor(REWARDS, requires_grad=True)
    (slope,) = torch.autograd.grad(log_partition(rewards, sigma0).sum(), rewards, create_graph=True)
    (curvature,) = torch.autograd.grad(slope.sum(), rewards)
    assert bool(curvature.isfinite().all())


@pytest.mark.parametrize("sigma0", [0.3, 0.55, 1.0, 1.4])
def test_log_partition_branches_meet(sigma0: float) -> None:
    seam = 1 - sigma0**2
    value, slope = value_and_slope([seam - 1e-9, seam + 1e-9], sigma0, torch.float64)
    assert float(value[1] - value[0]) == pytest.approx(2e-9 * float(slope[0]), abs=1e-14)
    assert float(slope[0]) == pytest.approx(float(slope[1]), abs=1e-8)


@settings(max_examples=60, deadline=None)
@given(st.floats(-1, 1), st.floats(1e-3, 1), st.floats(0.15, 100))
def test_likelihood_is_strictly_increasing(low: float, gap: float, sigma0: float) -> None:
    high = min(1.0, low + gap)
    value, slope = likelihood([low, high], sigma0)
    assert bool((slope > 0).all())
    if high - low >= 1e-3:
        assert float(value[0]) < float(value[1])


@settings(max_examples=60, deadline=None)
@given(st.floats(-1, 1, width=32), st.floats(*SIGMA0_RANGE))
def test_log_partition_is_finite_and_bounded_in_float32(reward: float, sigma0: float) -> None:
    value, slope = value_and_slope([reward], sigma0, torch.float32)
    assert -1 <= float(value) <= 1, "Z is a mean of exp(x) over [-1, 1]"
    assert bool(slope.isfinite().all())


def test_log_partition_limits_of_sigma0() -> None:
    rewards = [-0.5, 0.0, 0.5]
    narrow, _ = likelihood(rewards, 0.001)
    torch.testing.assert_close(narrow, torch.full_like(narrow, -(0.0005**2) * 2), rtol=1e-6, atol=0)
    wide, _ = value_and_slope(rewards, 1000.0, torch.float64)
    torch.testing.assert_close(wide, torch.full_like(wide, math.log(math.sinh(1))), rtol=0, atol=1e-6)


def test_log_partition_shape_and_dtype() -> None:
    rewards = torch.linspace(-1, 1, 6).reshape(2, 3)
    assert log_partition(rewards, 0.55).shape == (2, 3)
    half = log_partition(rewards.bfloat16(), 0.55)
    assert half.dtype == torch.bfloat16
    torch.testing.assert_close(half.float(), log_partition(rewards, 0.55), rtol=0, atol=1e-2)


@pytest.mark.parametrize("sigma0", [0.0, -0.55, 1e-4, 2e3, math.nan, math.inf])
def test_sigma0_outside_its_range_is_rejected(sigma0: float) -> None:
    rewards = torch.zeros(1)
    for call in (
        lambda: log_partition(rewards, sigma0),
        lambda: sample_truncated_normal(rewards, sigma0, 3),
        lambda: confidence_from_sigma0(sigma0),
    ):
        with pytest.raises(InputError, match=r"^sigma0=.*: expected a standard deviation from 0\.001 to 1000"):
            call()


@pytest.mark.parametrize(("reward", "sigma0"), [(0.0, 0.55), (1.0, 0.55), (-0.8, 0.05), (0.5, 30.0)])
def test_truncated_normal_samples_moments_and_support(reward: float, sigma0: float) -> None:
    count = 20000
    generator = torch.Generator().manual_seed(0)
    samples = sample_truncated_normal(torch.tensor([reward], dtype=torch.float64), sigma0, count, generator)
    assert samples.shape == (count, 1)
    assert float(samples.abs().max()) <= 1
    reference = truncnorm((-1 - reward) / sigma0, (1 - reward) / sigma0, loc=reward, scale=sigma0)
    assert float(samples.mean()) == pytest.approx(reference.mean(), abs=4 * reference.std() / math.sqrt(count))
    assert float(samples.std()) == pytest.approx(reference.std(), rel=0.03)


@pytest.mark.parametrize("sigma0", EXTREME_SIGMAS)
def test_truncated_normal_samples_at_extreme_sigmas_in_float32(sigma0: float) -> None:
    generator = torch.Generator().manual_seed(0)
    samples = sample_truncated_normal(torch.tensor(REWARDS), sigma0, 5000, generator)
    assert samples.dtype == torch.float32
    assert float(samples.abs().max()) <= 1, "NaN would fail this too"


def monte_carlo(rewards: list[float], count: int, repeats: int, baseline: bool) -> tuple[Tensor, Tensor]:
    """Values and slopes ``[repeats, rewards]`` of independent estimates at sigma0 = 0.55."""
    r = torch.tensor(rewards, dtype=torch.float64).expand(repeats, -1).clone().requires_grad_()
    generator = torch.Generator().manual_seed(1)
    value = log_partition_monte_carlo(r, 0.55, count, count, generator, baseline=baseline)
    value.sum().backward()
    assert r.grad is not None
    return value.detach(), r.grad


@pytest.mark.parametrize("baseline", [False, True])
def test_monte_carlo_agrees_with_the_closed_form_within_its_standard_error(baseline: bool) -> None:
    rewards = [-0.9, 0.0, 0.9]
    estimates = monte_carlo(rewards, 1000, repeats=200, baseline=baseline)
    for estimate, exact in zip(estimates, value_and_slope(rewards, 0.55, torch.float64), strict=True):
        standard_error = estimate.std(dim=0) / math.sqrt(len(estimate))
        assert bool((standard_error < 0.01).all())
        assert bool(((estimate.mean(dim=0) - exact).abs() < 4 * standard_error).all())


@pytest.mark.parametrize(("count", "least", "most"), [(10, 0.33, 0.71), (100, 0.10, 0.22), (1000, 0.03, 0.07)])
def test_monte_carlo_slope_rmse_with_and_without_baseline(count: int, least: float, most: float) -> None:
    rewards = [-0.9, -0.5, 0.0, 0.5, 0.9]
    _, exact = value_and_slope(rewards, 0.55, torch.float64)
    rmse, rmse_with_baseline = (
        (monte_carlo(rewards, count, 2000 if count < 1000 else 400, baseline)[1] - exact).square().mean(dim=0).sqrt()
        for baseline in (False, True)
    )
    # the bounds are printed to two digits, and the RMSE itself is estimated to some per cent
    assert bool((rmse > 0.93 * least).all())
    assert bool((rmse < 1.05 * most).all())
    assert bool((rmse / rmse_with_baseline > 1.6).all())


def test_monte_carlo_repeats_with_the_seed_and_scales_an_incoming_gradient() -> None:
    def run(factor: float) -> tuple[Tensor, Tensor]:
        r = torch.tensor([0.2, -0.4], requires_grad=True)
        value = log_partition_monte_carlo(r, 0.55, 50, 50, torch.Generator().manual_seed(3))
        (factor * value).sum().backward()
        assert r.grad is not None
        return value.detach(), r.grad

    (value, slope), (value_again, slope_tripled) = run(1.0), run(3.0)
    assert torch.equal(value, value_again)
    torch.testing.assert_close(slope_tripled, 3 * slope)


@pytest.mark.parametrize("sigma0", EXTREME_SIGMAS)
def test_monte_carlo_is_finite_at_extreme_sigmas_in_float32(sigma0: float) -> None:
    r = torch.tensor(REWARDS, requires_grad=True)
    value = log_partition_monte_carlo(r, sigma0, 100, 100, torch.Generator().manual_seed(0))
    value.sum().backward()
    assert r.grad is not None
    assert bool(r.grad.isfinite().all())
    assert bool(value.isfinite().all())


def test_confidence_of_the_default_sigma0() -> None:
    assert round(confidence_from_sigma0(0.55), 3) == 0.931
    assert confidence_from_sigma0(1.0) == pytest.approx(0.6826894921370859, abs=1e-15)


@settings(max_examples=60, deadline=None)
@given(st.floats(0.15, 1000))
def test_confidence_and_sigma0_are_inverses(sigma0: float) -> None:
    assert sigma0_from_confidence(confidence_from_sigma0(sigma0)) == pytest.approx(sigma0, rel=1e-3)


def test_more_confidence_means_a_smaller_sigma0() -> None:
    assert sigma0_from_confidence(0.99) < sigma0_from_confidence(0.9) < sigma0_from_confidence(0.5)


@pytest.mark.parametrize("alpha", [0.0, 1.0, -0.2, 1.5, math.nan])
def test_confidence_outside_its_range_is_rejected(alpha: float) -> None:
    with pytest.raises(InputError, match=r"^alpha=.*: expected a number between 0 and 1"):
        sigma0_from_confidence(alpha)


def test_vanishing_confidence_is_rejected() -> None:
    with pytest.raises(InputError, match=r"^alpha=1e-05: expected at least 0\.0008"):
        sigma0_from_confidence(1e-5)
